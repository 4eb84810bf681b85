// Packs written byte by byte, without the code that is tested.
#pragma once

#include <string>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"

namespace nadir::test {

inline std::string big_endian(std::uint32_t value) {
  return {static_cast<char>(value >> 24), static_cast<char>(value >> 16), static_cast<char>(value >> 8),
          static_cast<char>(value)};
}

inline std::string pack_of(const std::vector<std::string>& tiles) {
  std::string head = "NADIRPK1" + big_endian(static_cast<std::uint32_t>(tiles.size())), body;
  for (const std::string& tile : tiles) {
    const Sha256 digest = sha256(as_bytes(tile));
    head.append(reinterpret_cast<const char*>(digest.bytes.data()), digest.bytes.size());
    head += big_endian(static_cast<std::uint32_t>(tile.size()));
    body += tile;
  }
  return head + body;
}

}  // namespace nadir::test
