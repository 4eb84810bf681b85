#include "upload/pack.hpp"

#include <fmt/format.h>

#include <set>

#include "base/error.hpp"

namespace nadir {
namespace {

[[noreturn]] void refuse(std::string expected, std::string found) {
  throw Error({.what = "these tiles cannot be packed", .expected = std::move(expected), .found = std::move(found)});
}

void append_u32(Bytes& bytes, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) bytes.push_back(static_cast<std::uint8_t>(value >> shift));
}

}  // namespace

std::uint64_t pack_size(std::span<const PackEntry> entries) {
  if (entries.empty() || entries.size() > kMaxPackTiles) {
    refuse(fmt::format("1 to {} tiles", kMaxPackTiles), fmt::format("{}", entries.size()));
  }
  std::set<Sha256> seen;
  std::uint64_t size = kPackHeadSize + entries.size() * kPackEntrySize;
  for (const PackEntry& entry : entries) {
    if (entry.size == 0 || entry.size > kMaxPackTileSize) {
      refuse(fmt::format("tiles of 1 to {} bytes", kMaxPackTileSize),
             fmt::format("{} of {} bytes", entry.sha256.hex(), entry.size));
    }
    if (!seen.insert(entry.sha256).second) refuse("each tile once", entry.sha256.hex() + " twice");
    size += entry.size;
  }
  if (size > kMaxPackSize) refuse(fmt::format("at most {} bytes", kMaxPackSize), fmt::format("{}", size));
  return size;
}

std::size_t entries_of_next_pack(std::span<const PackEntry> entries) {
  std::uint64_t size = kPackHeadSize;
  std::size_t count = 0;
  while (count < entries.size() && count < kMaxPackTiles) {
    size += kPackEntrySize + entries[count].size;
    if (count > 0 && size > kMaxPackSize) break;
    ++count;
    if (size >= kGoodPackSize) break;
  }
  return count;
}

Bytes pack_head(std::span<const PackEntry> entries) {
  Bytes bytes;
  bytes.reserve(pack_size(entries));
  bytes.insert(bytes.end(), kPackMagic.begin(), kPackMagic.end());
  append_u32(bytes, static_cast<std::uint32_t>(entries.size()));
  for (const PackEntry& entry : entries) {
    bytes.insert(bytes.end(), entry.sha256.bytes.begin(), entry.sha256.bytes.end());
    append_u32(bytes, entry.size);
  }
  return bytes;
}

}  // namespace nadir
