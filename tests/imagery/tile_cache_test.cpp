#include "imagery/tile_cache.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "imagery/synthetic_tiles.hpp"

namespace nadir {
namespace {

class OneTile final : public TileSource {
 public:
  explicit OneTile(Bytes bytes) : bytes_(std::move(bytes)) {}
  ZoomRange zooms() const override { return {0, 0}; }
  std::optional<Bytes> read(const TileKey&) const override { return bytes_; }

 private:
  Bytes bytes_;
};

// One tile that cannot be read until `works`.
class FailingTiles final : public TileSource {
 public:
  explicit FailingTiles(Bytes bytes) : bytes_(std::move(bytes)) {}
  ZoomRange zooms() const override { return {0, 0}; }
  std::optional<Bytes> read(const TileKey&) const override {
    ++reads;
    return works ? std::optional(bytes_) : std::nullopt;
  }

  mutable bool works = false;
  mutable int reads = 0;

 private:
  Bytes bytes_;
};

TEST(TileCache, EvictsTheLeastRecentlyUsed) {
  const test::WaveTiles tiles({10, 10}, 10);
  TileCache cache(tiles, 2);
  const TileKey a{10, 1, 1}, b{10, 2, 1}, c{10, 3, 1};
  for (const TileKey& key : {a, b, a, c, a, b}) cache.get(key, Colour::grey, 1);
  EXPECT_EQ(tiles.reads.at(a), 1);  // used again before c came
  EXPECT_EQ(tiles.reads.at(b), 2);
  EXPECT_EQ(tiles.reads.at(c), 1);
}

// A medium that fails once must not cost the tile for the rest of the flight; one that is broken is not asked each
// time.
TEST(TileCache, ReadsAHoleAgainAfterAWhile) {
  const FailingTiles tiles(encode_image(cv::Mat(kTileSize, kTileSize, CV_8UC3, cv::Scalar::all(9)), ImageFormat::png));
  TileCache cache(tiles, 4);
  const TileKey key{0, 0, 0};
  for (int i = 0; i < 16; ++i) EXPECT_TRUE(cache.get(key, Colour::grey, 1).image.empty());
  EXPECT_EQ(tiles.reads, 2);
  tiles.works = true;
  int requests = 1;
  while (requests < 100 && cache.get(key, Colour::grey, 1).image.empty()) ++requests;
  EXPECT_LE(requests, 8);
  EXPECT_EQ(tiles.reads, 3);
  for (int i = 0; i < 16; ++i) EXPECT_FALSE(cache.get(key, Colour::grey, 1).image.empty());
  EXPECT_EQ(tiles.reads, 3);  // kept as any other
}

TEST(TileCache, ReducesImageAndMaskConsistently) {
  cv::Mat picture(kTileSize, kTileSize, CV_8UC4, cv::Scalar(0, 0, 0, 255));
  for (int column = 0; column < kTileSize; column += 2) picture.col(column).setTo(cv::Scalar(200, 200, 200, 255));
  picture.at<cv::Vec4b>(9, 6)[3] = 0;  // one transparent pixel, in the cell (row 2, column 1)
  const OneTile tiles(encode_image(picture, ImageFormat::png));
  TileCache cache(tiles, 4);
  const DecodedTile& tile = cache.get({0, 0, 0}, Colour::grey, 4);
  ASSERT_EQ(tile.image.size(), cv::Size(64, 64));
  EXPECT_EQ(tile.image.at<std::uint8_t>(30, 30), 100);
  EXPECT_EQ(tile.mask.at<std::uint8_t>(2, 1), 0);
  EXPECT_EQ(cv::countNonZero(tile.mask), 64 * 64 - 1);
}

TEST(TileCache, RejectsBadTiles) {
  const OneTile small(encode_image(cv::Mat(128, 128, CV_8UC3, cv::Scalar::all(9)), ImageFormat::png));
  const OneTile rubbish(Bytes{1, 2, 3});
  EXPECT_THROW(TileCache(small, 4).get({0, 0, 0}, Colour::grey, 1), Error);
  EXPECT_THROW(TileCache(rubbish, 4).get({0, 0, 0}, Colour::grey, 1), Error);
}

}  // namespace
}  // namespace nadir
