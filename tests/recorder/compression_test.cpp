#include <gtest/gtest.h>
#include <lz4frame.h>

#include "recorder/mcap_format.hpp"

namespace nadir {
namespace {

Bytes text(std::size_t size) {
  Bytes bytes;
  while (bytes.size() < size) {
    for (const char c : std::string_view("chunks of a flight, over and over; ")) {
      bytes.push_back(static_cast<std::uint8_t>(c));
    }
  }
  return bytes;
}

Bytes lz4(const Bytes& bytes) {
  Bytes out(LZ4F_compressFrameBound(bytes.size(), nullptr));
  out.resize(LZ4F_compressFrame(out.data(), out.size(), bytes.data(), bytes.size(), nullptr));
  return out;
}

TEST(ChunkCompression, UnfoldsEachKind) {
  const Bytes plain = text(3'000'000);
  EXPECT_EQ(decompress_chunk("", plain, plain.size()), plain);
  EXPECT_EQ(decompress_chunk("zstd", compress_zstd(plain, 1), plain.size()), plain);
  EXPECT_EQ(decompress_chunk("lz4", lz4(plain), plain.size()), plain);
}

TEST(ChunkCompression, AnotherSizeOrKindIsRefused) {
  const Bytes plain = text(5000), packed = compress_zstd(plain, 1);
  EXPECT_FALSE(decompress_chunk("zstd", packed, plain.size() - 1));
  EXPECT_FALSE(decompress_chunk("zstd", packed, plain.size() + 1));
  EXPECT_FALSE(decompress_chunk("zstd", packed, kLargestChunk + 1));
  EXPECT_FALSE(decompress_chunk("brotli", packed, plain.size()));
  EXPECT_FALSE(decompress_chunk("", packed, plain.size()));
  EXPECT_FALSE(decompress_chunk("lz4", packed, plain.size()));
}

TEST(ChunkCompression, DamagedBytesAreRefused) {
  const Bytes plain = text(20'000);
  for (const auto& [kind, packed] : {std::pair("zstd", compress_zstd(plain, 1)), std::pair("lz4", lz4(plain))}) {
    for (std::size_t cut = 0; cut < packed.size(); ++cut) {
      EXPECT_FALSE(decompress_chunk(kind, ByteView(packed).first(cut), plain.size())) << kind << " cut at " << cut;
    }
  }
}

// RFC 1952's checksum of "123456789", as every catalogue of CRCs lists it.
TEST(ChunkCompression, TheChecksumIsThatOfZip) {
  EXPECT_EQ(crc32_of(as_bytes("123456789")), 0xCBF43926U);
  EXPECT_EQ(crc32_of(as_bytes("6789"), crc32_of(as_bytes("12345"))), 0xCBF43926U);
}

}  // namespace
}  // namespace nadir
