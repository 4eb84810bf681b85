// Compression of MCAP chunks ("", "zstd", "lz4") and the checksum of everything in MCAP.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "base/bytes.hpp"

namespace nadir {

// No chunk that is read may unfold to more: nobody writes such, and memory ends somewhere.
inline constexpr std::uint64_t kLargestChunk = std::uint64_t{256} << 20;

// The CRC of zlib and of zip files (polynomial 0xEDB88320), continued from `before`.
std::uint32_t crc32_of(ByteView bytes, std::uint32_t before = 0);

Bytes compress_zstd(ByteView bytes, int level);

// size: what the chunk says that it unfolds to. Nothing for damaged bytes, another size, an unknown compression or too
// large a size.
std::optional<Bytes> decompress_chunk(std::string_view compression, ByteView bytes, std::uint64_t size);

}  // namespace nadir
