// Water of a package's vectors is no ground: in the tiles' masks, and in the matchability of places.
#include "package_build/water_mask.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/random.hpp"
#include "imagery/codecs.hpp"
#include "package_build/matchability_survey.hpp"

namespace nadir {
namespace {

constexpr int kMaskZoom = 17;

// Noise that a map finds again in itself, on water as on land.
class Noisy final : public TileSource {
 public:
  ZoomRange zooms() const override { return {kMaskZoom, kMaskZoom}; }
  std::optional<Bytes> read(const TileKey& key) const override {
    cv::Mat tile(kTileSize, kTileSize, CV_8UC1);
    Random random = Random(5).fork("tile", (std::uint64_t{key.x} << 32U) | key.y);
    for (int row = 0; row < kTileSize; row += 4) {
      for (int column = 0; column < kTileSize; column += 4) {
        tile(cv::Rect(column, row, 4, 4)).setTo(random.uniform(20, 230));
      }
    }
    return encode_image(tile, ImageFormat::png);
  }
  std::optional<Bytes> read_mask(const TileKey& key) const override {
    if (key.x % 2 == 0) return std::nullopt;
    cv::Mat mask(kTileSize, kTileSize, CV_8UC1, cv::Scalar(255));
    mask.row(0).setTo(0);
    return encode_image(mask, ImageFormat::png);
  }
};

VectorLayer lake(LonLat south_west, LonLat north_east, bool with_island) {
  const auto ring = [](LonLat a, LonLat b) {
    return std::vector<LonLat>{a, {b.lon_deg, a.lat_deg}, b, {a.lon_deg, b.lat_deg}, a};
  };
  VectorLayer layer{"us", "MIT", {{VectorClass::water, "lake", true, {ring(south_west, north_east)}}}};
  const auto between = [&](double share) {
    return LonLat{south_west.lon_deg + share * (north_east.lon_deg - south_west.lon_deg),
                  south_west.lat_deg + share * (north_east.lat_deg - south_west.lat_deg)};
  };
  if (with_island) layer.features[0].parts.push_back(ring(between(0.4), between(0.6)));
  return layer;
}

TEST(WaterMask, MasksWaterOnTopOfWhatIsMaskedAlready) {
  const TileKey key = tile_at({11.0, 48.0}, kMaskZoom);
  const LonLatBox box = bounds_of(key);
  const LonLat middle{(box.west_deg + box.east_deg) / 2, (box.south_deg + box.north_deg) / 2};
  const Noisy tiles;
  const VectorLayer vectors = lake({box.west_deg, box.south_deg}, middle, true);
  const WaterMaskedTiles masked(tiles, vectors);
  EXPECT_EQ(masked.areas(), 1U);
  EXPECT_EQ(masked.read(key), tiles.read(key));
  const auto bytes = masked.read_mask(key);
  ASSERT_TRUE(bytes);
  const cv::Mat mask = decode_image(*bytes, Colour::grey, "mask").image;
  const double land = cv::countNonZero(mask) / 65536.0;
  EXPECT_NEAR(land, 0.75 + 0.25 * 0.04, 0.012) << "a quarter is the lake, less its island";
  EXPECT_EQ(mask.at<std::uint8_t>(250, 5), 0);
  EXPECT_EQ(mask.at<std::uint8_t>(192, 64), 255) << "the island";
  EXPECT_EQ(mask.at<std::uint8_t>(60, 200), 255);

  const TileKey beside{key.z, key.x + 3 - key.x % 2, key.y + 5};  // with a mask of its own, without water
  EXPECT_EQ(masked.read_mask(beside), tiles.read_mask(beside));
  const TileKey own{key.z, key.x | 1U, key.y};
  const LonLatBox there = bounds_of(own);
  const VectorLayer more =
      lake({there.west_deg, there.south_deg}, {there.east_deg, (there.south_deg + there.north_deg) / 2}, false);
  const cv::Mat both = decode_image(*WaterMaskedTiles(tiles, more).read_mask(own), Colour::grey, "mask").image;
  EXPECT_EQ(both.at<std::uint8_t>(0, 100), 0);
  EXPECT_EQ(both.at<std::uint8_t>(60, 100), 255);
  EXPECT_EQ(both.at<std::uint8_t>(250, 100), 0);
}

TEST(WaterMask, APlaceOverWaterIsPoorHoweverWellTheImageRepeats) {
  const LonLat origin{11.0, 48.0};
  const LocalFrame frame(origin);
  Region region;
  region.rings.push_back({{-300, -60}, {300, -60}, {300, 60}, {-300, 60}});
  const Noisy tiles;
  const VectorLayer vectors = lake(origin, frame.lonlat_from_plane({2000, 2000}), false);  // and south of the origin:
  VectorLayer east = vectors;
  east.features[0].parts = {{frame.lonlat_from_plane({0, -2000}), frame.lonlat_from_plane({2000, -2000}),
                             frame.lonlat_from_plane({2000, 2000}), frame.lonlat_from_plane({0, 2000}),
                             frame.lonlat_from_plane({0, -2000})}};
  NoProgress progress;
  const auto survey = [&](const VectorLayer& layer) {
    const WaterMaskedTiles masked(tiles, layer);
    return survey_matchability(masked, region, frame, kMaskZoom, 60, matchability_options(120, 1.0, 100), 2, progress);
  };
  const MatchabilityMap plain = survey({}), known = survey(east);
  const LonLat water = frame.lonlat_from_plane({200, 0}), land = frame.lonlat_from_plane({-200, 0});
  ASSERT_NE(plain.at(water), nullptr);
  EXPECT_EQ(plain.at(water)->cls, MatchClass::good) << "what the image alone says";
  EXPECT_EQ(known.at(water)->cls, MatchClass::poor);
  EXPECT_EQ(known.at(water)->valid, 0);
  EXPECT_EQ(known.at(land)->cls, plain.at(land)->cls);
}

TEST(WaterMask, WithoutWaterNothingChanges) {
  const Noisy tiles;
  VectorLayer layer{"us",
                    "MIT",
                    {{VectorClass::wood, "wood", true, {{{11, 48}, {11.1, 48}, {11.1, 48.1}, {11, 48}}}},
                     {VectorClass::water, "river", false, {{{11, 48}, {11.1, 48.1}}}}}};
  const WaterMaskedTiles masked(tiles, layer);
  EXPECT_EQ(masked.areas(), 0U);
  for (std::uint32_t i = 0; i < 4; ++i) {
    TileKey key = tile_at({11.0, 48.0}, kMaskZoom);
    key.x += i;
    EXPECT_EQ(masked.read_mask(key), tiles.read_mask(key));
  }
}

}  // namespace
}  // namespace nadir
