#include "upload/pack.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "upload/sample_pack.hpp"

namespace nadir {
namespace {

PackEntry entry_of(std::uint8_t name, std::uint32_t size) {
  PackEntry entry{{}, size};
  entry.sha256.bytes[0] = name;
  return entry;
}

TEST(Pack, HeaderMatchesTheContract) {
  const std::vector<std::string> tiles{"one", std::string(300, 'x')};
  std::vector<PackEntry> entries;
  for (const std::string& tile : tiles) {
    entries.push_back({sha256(as_bytes(tile)), static_cast<std::uint32_t>(tile.size())});
  }
  const std::string whole = test::pack_of(tiles);
  const Bytes head = pack_head(entries);
  EXPECT_EQ(as_text(head), whole.substr(0, head.size()));
  EXPECT_EQ(pack_size(entries), whole.size());
  EXPECT_EQ(head.size(), whole.size() - 303);
}

TEST(Pack, RejectsInvalidContents) {
  EXPECT_THROW(pack_size({}), Error);
  const std::vector<std::vector<PackEntry>> wrong{{entry_of(1, 0)},
                                                  {entry_of(1, (1U << 20) + 1)},
                                                  {entry_of(1, 5), entry_of(1, 5)},
                                                  std::vector<PackEntry>(2001, entry_of(1, 1))};
  for (const auto& entries : wrong) {
    EXPECT_THROW(pack_size(entries), Error);
    EXPECT_THROW(pack_head(entries), Error);
  }
  std::vector<PackEntry> nine;
  for (std::uint8_t i = 0; i < 9; ++i) nine.push_back(entry_of(i, 1U << 20));
  EXPECT_THROW(pack_size(nine), Error) << "nine tiles of 1 MiB are more than 8 MiB";
}

TEST(Pack, IsFilledUpToItsLimit) {
  EXPECT_EQ(entries_of_next_pack({}), 0U);
  EXPECT_EQ(entries_of_next_pack(std::vector{entry_of(1, 10)}), 1U);
  std::vector<PackEntry> entries;
  for (int i = 0; i < 3000; ++i) {
    PackEntry entry = entry_of(static_cast<std::uint8_t>(i), 20'000);
    entry.sha256.bytes[1] = static_cast<std::uint8_t>(i >> 8);
    entries.push_back(entry);
  }
  const std::size_t count = entries_of_next_pack(entries);
  EXPECT_EQ(count, (4U << 20) / 20'036 + 1) << "the first that reaches 4 MiB closes the pack";
  EXPECT_LE(pack_size(std::span(entries).first(count)), kMaxPackSize);
  for (PackEntry& entry : entries) entry.size = 1;
  EXPECT_EQ(entries_of_next_pack(entries), 2000U);
  for (PackEntry& entry : entries) entry.size = 1U << 20;
  EXPECT_EQ(entries_of_next_pack(entries), 4U);
}

using test::big_endian;
using test::pack_of;

const std::vector<std::string> kTiles{"first tile", std::string(5000, 'b'), "c"};

// The tiles that a reader gives, fed in pieces of this size.
std::vector<std::string> read(
    const std::string& pack, std::size_t piece, std::size_t claimed = 0,
    const PackReader::Announced& announced = [](const PackEntry&) { return true; }) {
  std::vector<std::string> tiles;
  PackReader reader(claimed > 0 ? claimed : pack.size(), announced, [&](const PackEntry& entry, ByteView bytes) {
    EXPECT_EQ(entry.size, bytes.size());
    tiles.emplace_back(as_text(bytes));
  });
  for (std::size_t at = 0; at < pack.size(); at += piece) {
    reader.feed(as_bytes(std::string_view(pack).substr(at, piece)));
  }
  reader.finish();
  return tiles;
}

TEST(PackReader, ReturnsTheTilesForAnyChunking) {
  const std::string pack = pack_of(kTiles);
  for (const std::size_t piece : {std::size_t{1}, std::size_t{7}, std::size_t{12}, std::size_t{4096}, pack.size()}) {
    EXPECT_EQ(read(pack, piece), kTiles) << piece;
  }
}

TEST(PackReader, RejectsEveryTruncation) {
  const std::string pack = pack_of(kTiles);
  for (std::size_t size = 0; size < pack.size(); size += 11) {
    EXPECT_THROW(read(pack.substr(0, size), 64, pack.size()), Error) << size;
  }
}

TEST(PackReader, RejectsFalseSizes) {
  const std::string pack = pack_of(kTiles);
  EXPECT_THROW(read(pack, 64, pack.size() - 1), Error);
  EXPECT_THROW(read(pack, 64, pack.size() + 1), Error);
  EXPECT_THROW(read(pack + "x", 64, pack.size()), Error) << "bytes behind the last tile";
  EXPECT_THROW(read(pack, 64, 0x7FFFFFFFFFFFFFFF), Error);
  EXPECT_THROW(read(pack, 64, 12), Error);
  for (const std::uint32_t count : {0U, 1U, 2U, 4U, 2001U, 0x80000000U, 0xFFFFFFFFU}) {
    std::string forged = pack;
    forged.replace(8, 4, big_endian(count));
    EXPECT_THROW(read(forged, 64), Error) << count;
  }
  for (const std::uint32_t size : {0U, 9U, 11U, 0x100001U, 0xFFFFFFFFU}) {
    std::string forged = pack;
    forged.replace(12 + 32, 4, big_endian(size));
    EXPECT_THROW(read(forged, 64), Error) << size;
  }
}

// A small head that promises much must not make the reader allocate it: the claimed length bounds the count first.
TEST(PackReader, RejectsMoreTilesThanTheBytesCanHold) {
  const std::string pack = "NADIRPK1" + big_endian(2000) + std::string(60, 'x');
  EXPECT_THROW(read(pack, 64), Error);
}

TEST(PackReader, RejectsSwappedTiles) {
  std::string pack = pack_of({"aaaa", "bbbb"});
  std::swap_ranges(pack.end() - 8, pack.end() - 4, pack.end() - 4);
  EXPECT_THROW(read(pack, 64), Error);
  EXPECT_THROW(read(pack_of({"aaaa", "aaaa"}), 64), Error) << "one twice";
}

TEST(PackReader, RejectsUnannouncedTilesBeforeAcceptingAny) {
  int taken = 0;
  const std::string pack = pack_of(kTiles);
  PackReader reader(
      pack.size(), [](const PackEntry& entry) { return entry.size != 1; },
      [&](const PackEntry&, ByteView) { ++taken; });
  EXPECT_THROW(reader.feed(as_bytes(pack)), Error);
  EXPECT_EQ(taken, 0);
}

TEST(PackReader, DetectsEveryFlippedBit) {
  const std::string pack = pack_of({"some tile", "another tile"});
  for (std::size_t at = 0; at < pack.size(); ++at) {
    std::string flipped = pack;
    flipped[at] = static_cast<char>(flipped[at] ^ 0x10);
    EXPECT_THROW(read(flipped, 16), Error) << at;
  }
}

}  // namespace
}  // namespace nadir
