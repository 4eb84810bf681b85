#include "upload/pack.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "upload/sample_pack.hpp"

namespace nadir {
namespace {

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

TEST(PackReader, GivesTheTilesWhateverThePieces) {
  const std::string pack = pack_of(kTiles);
  for (const std::size_t piece : {std::size_t{1}, std::size_t{7}, std::size_t{12}, std::size_t{4096}, pack.size()}) {
    EXPECT_EQ(read(pack, piece), kTiles) << piece;
  }
}

TEST(PackReader, RefusesEveryCut) {
  const std::string pack = pack_of(kTiles);
  for (std::size_t size = 0; size < pack.size(); size += 11) {
    EXPECT_THROW(read(pack.substr(0, size), 64, pack.size()), Error) << size;
  }
}

TEST(PackReader, RefusesLyingSizes) {
  const std::string pack = pack_of(kTiles);
  EXPECT_THROW(read(pack, 64, pack.size() - 1), Error);
  EXPECT_THROW(read(pack, 64, pack.size() + 1), Error);
  EXPECT_THROW(read(pack + "x", 64, pack.size()), Error) << "bytes behind the last tile";
  EXPECT_THROW(read(pack, 64, 0x7FFFFFFFFFFFFFFF), Error);
  EXPECT_THROW(read(pack, 64, 12), Error);
  for (const std::uint32_t count : {0U, 1U, 2U, 4U, 2001U, 0x80000000U, 0xFFFFFFFFU}) {
    std::string lie = pack;
    lie.replace(8, 4, big_endian(count));
    EXPECT_THROW(read(lie, 64), Error) << count;
  }
  for (const std::uint32_t size : {0U, 9U, 11U, 0x100001U, 0xFFFFFFFFU}) {
    std::string lie = pack;
    lie.replace(12 + 32, 4, big_endian(size));
    EXPECT_THROW(read(lie, 64), Error) << size;
  }
}

// A small head that promises much must not make the reader allocate it: the claimed length bounds the count first.
TEST(PackReader, AFewBytesCannotPromiseThousandsOfTiles) {
  const std::string pack = "NADIRPK1" + big_endian(2000) + std::string(60, 'x');
  EXPECT_THROW(read(pack, 64), Error);
}

TEST(PackReader, RefusesSwappedTiles) {
  std::string pack = pack_of({"aaaa", "bbbb"});
  std::swap_ranges(pack.end() - 8, pack.end() - 4, pack.end() - 4);
  EXPECT_THROW(read(pack, 64), Error);
  EXPECT_THROW(read(pack_of({"aaaa", "aaaa"}), 64), Error) << "one twice";
}

TEST(PackReader, RefusesWhatWasNotAnnouncedBeforeAnyTileIsTaken) {
  int taken = 0;
  const std::string pack = pack_of(kTiles);
  PackReader reader(
      pack.size(), [](const PackEntry& entry) { return entry.size != 1; },
      [&](const PackEntry&, ByteView) { ++taken; });
  EXPECT_THROW(reader.feed(as_bytes(pack)), Error);
  EXPECT_EQ(taken, 0);
}

TEST(PackReader, EveryFlippedBitIsNoticed) {
  const std::string pack = pack_of({"some tile", "another tile"});
  for (std::size_t at = 0; at < pack.size(); ++at) {
    std::string flipped = pack;
    flipped[at] = static_cast<char>(flipped[at] ^ 0x10);
    EXPECT_THROW(read(flipped, 16), Error) << at;
  }
}

}  // namespace
}  // namespace nadir
