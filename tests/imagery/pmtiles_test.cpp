// PMTiles: what is written is read back, by us here and by others in tests/third_party; what is damaged is refused.
#include "imagery/pmtiles.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using ::testing::HasSubstr;

class Pmtiles : public ::testing::Test {
 protected:
  void add(const TileKey& key, const std::string& text) { tiles_[key] = Bytes(text.begin(), text.end()); }

  PmtilesCounts write(const std::string& name = "set.pmtiles") {
    std::vector<PmtilesTile> list;
    for (const auto& [key, bytes] : tiles_)
      list.push_back({key, sha256(bytes), static_cast<std::uint32_t>(bytes.size())});
    return write_pmtiles(
        folder_ / name, list, {ImageFormat::png, {7, 46, 9, 48}, R"({"name":"a set"})"},
        [this](const TileKey& key) { return tiles_.at(key); }, [this] { ++written_; });
  }
  PmtilesReader open(const std::string& name = "set.pmtiles") { return PmtilesReader(InputFile(folder_ / name)); }
  void expect_all() {
    const PmtilesReader reader = open();
    std::vector<TileKey> keys;
    for (const auto& [key, bytes] : tiles_) {
      keys.push_back(key);
      EXPECT_EQ(reader.read(key), bytes) << to_text(key);
      EXPECT_EQ(reader.stored_size(key), bytes.size());
    }
    EXPECT_EQ(reader.keys(), keys);
  }
  std::string refusal(ByteView bytes) {
    write_file_atomic(folder_ / "bad", bytes);
    try {
      const PmtilesReader reader = open("bad");
      for (const TileKey& key : reader.keys()) static_cast<void>(reader.read(key));
      return {};
    } catch (const Error& error) {
      return error.what();
    }
  }

  test::TemporaryFolder folder_;
  std::map<TileKey, Bytes> tiles_;
  int written_ = 0;
};

// The specification's own numbers.
TEST_F(Pmtiles, IdsFollowTheHilbertCurve) {
  EXPECT_EQ(pmtiles_id({0, 0, 0}), 0U);
  EXPECT_EQ(pmtiles_id({1, 0, 0}), 1U);
  EXPECT_EQ(pmtiles_id({1, 0, 1}), 2U);
  EXPECT_EQ(pmtiles_id({1, 1, 1}), 3U);
  EXPECT_EQ(pmtiles_id({1, 1, 0}), 4U);
  EXPECT_EQ(pmtiles_id({2, 0, 0}), 5U);
  EXPECT_EQ(pmtiles_id({12, 3423, 1763}), 19078479U);
  EXPECT_FALSE(tile_of_pmtiles_id(~std::uint64_t{0}));
}

TEST_F(Pmtiles, EachIdIsOneTileAndTheNextIsItsNeighbour) {
  std::set<TileKey> seen;
  std::optional<TileKey> last;
  for (std::uint64_t id = pmtiles_id({6, 0, 0}); id < pmtiles_id({7, 0, 0}); ++id) {
    const auto key = tile_of_pmtiles_id(id);
    ASSERT_TRUE(key && key->valid());
    EXPECT_EQ(pmtiles_id(*key), id);
    EXPECT_TRUE(seen.insert(*key).second);
    if (last) {
      const auto step = [](std::uint32_t a, std::uint32_t b) { return a > b ? a - b : b - a; };
      EXPECT_EQ(step(last->x, key->x) + step(last->y, key->y), 1U);
    }
    last = key;
  }
  Random random(3);
  for (int i = 0; i < 2000; ++i) {
    const auto zoom = static_cast<std::uint8_t>(random.integer(0, kMaxZoom));
    const TileKey key{zoom, static_cast<std::uint32_t>(random.integer(0, (1 << zoom) - 1)),
                      static_cast<std::uint32_t>(random.integer(0, (1 << zoom) - 1))};
    EXPECT_EQ(tile_of_pmtiles_id(pmtiles_id(key)), key);
  }
}

TEST_F(Pmtiles, EqualContentsAreThereOnceAndNeighboursInOneEntry) {
  for (std::uint64_t id = 100; id < 110; ++id) add(*tile_of_pmtiles_id(id), "sea");
  add(*tile_of_pmtiles_id(110), "land");
  add(*tile_of_pmtiles_id(111), "sea");
  add({9, 268, 179}, "town");
  const PmtilesCounts counts = write();
  EXPECT_EQ(counts.tiles, 13U);
  EXPECT_EQ(counts.entries, 4U);
  EXPECT_EQ(counts.contents, 3U);
  EXPECT_EQ(written_, 3);
  expect_all();
  const PmtilesReader reader = open();
  EXPECT_EQ(reader.zooms(), (ZoomRange{4, 9}));
  EXPECT_EQ(reader.metadata(), R"({"name":"a set"})");
  EXPECT_EQ(reader.tile_type(), "png");
  EXPECT_FALSE(reader.read({9, 0, 0}));
  EXPECT_FALSE(reader.read({4, 0, 0}));
}

TEST_F(Pmtiles, ManyTilesNeedLeavesAndTheSameTilesGiveTheSameBytes) {
  Random random(7);
  for (std::uint32_t x = 0; x < 200; ++x) {
    for (std::uint32_t y = 0; y < 150; ++y) {
      add({14, 8000 + x, 5000 + y}, std::to_string(random.integer(0, 1 << 30)) + std::string(x % 7, '.'));
    }
  }
  write();
  expect_all();
  EXPECT_GT(read_file(folder_ / "set.pmtiles")[48] + 256 * read_file(folder_ / "set.pmtiles")[49], 0) << "leaves";
  write("again");
  EXPECT_EQ(read_file(folder_ / "again"), read_file(folder_ / "set.pmtiles"));
}

TEST_F(Pmtiles, WhatCannotBeWrittenIsAnError) {
  EXPECT_THROW(write(), Error) << "no tiles";
  add({3, 1, 1}, "x");
  write();
  EXPECT_THROW(write(), Error) << "it exists";
  const std::vector<PmtilesTile> twice(2, {{3, 1, 1}, sha256(as_bytes("x")), 1});
  const auto read = [](const TileKey&) { return Bytes{'x', 'y'}; };
  EXPECT_THROW(write_pmtiles(folder_ / "twice", twice, {}, read, [] {}), Error);
  EXPECT_THROW(write_pmtiles(folder_ / "size", {twice[0]}, {}, read, [] {}), Error);
}

TEST_F(Pmtiles, DamageIsRefusedOrShowsInTheTilesAlone) {
  for (std::uint32_t x = 0; x < 40; ++x) add({12, 100 + x, 77}, "tile " + std::to_string(x));
  write();
  const Bytes good = read_file(folder_ / "set.pmtiles");
  EXPECT_EQ(refusal(good), "");
  for (std::size_t size = 0; size < good.size(); size += 1 + good.size() / 60) {
    EXPECT_NE(refusal(ByteView(good).first(size)), "") << size;
  }
  const auto changed = [&](std::size_t at, std::uint8_t value) {
    Bytes bad = good;
    bad[at] = value;
    return refusal(bad);
  };
  EXPECT_THAT(changed(7, 2), HasSubstr("version 3"));
  EXPECT_THAT(changed(97, 4), HasSubstr("gzip"));
  EXPECT_THAT(changed(98, 2), HasSubstr("compressed a second time"));
  EXPECT_THAT(changed(99, 1), HasSubstr("vector tiles"));
  EXPECT_THAT(changed(15, 0xff), HasSubstr("the root directory"));
  EXPECT_THAT(changed(130, static_cast<std::uint8_t>(good[130] ^ 0x55)), HasSubstr("a directory"));
  Random random(11);
  for (int i = 0; i < 3000; ++i) {  // no crash, and no bytes from beyond
    Bytes bad = good;
    for (int n = 0; n < 3; ++n) {
      bad[static_cast<std::size_t>(random.integer(0, static_cast<int>(bad.size()) - 1))] =
          static_cast<std::uint8_t>(random.integer(0, 255));
    }
    static_cast<void>(refusal(bad));
  }
}

}  // namespace
}  // namespace nadir
