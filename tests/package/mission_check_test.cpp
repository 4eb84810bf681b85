#include "package/mission_check.hpp"

#include <gtest/gtest.h>

#include "base/random.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/coverage_requirement.hpp"
#include "package/package_maker.hpp"
#include "package/tile_image.hpp"

namespace nadir {
namespace {

using test::mission_yaml;

constexpr std::size_t kPixels = 256UL * 256UL;

Mission sample_mission(const std::map<std::string, std::string>& replacements = {}) {
  return parse_mission(mission_yaml(replacements), "m.yaml").mission.value();
}

std::vector<Sidecar> all_tiles(const Mission& mission) {
  std::vector<Sidecar> tiles;
  for (int zoom = mission.zoom.min; zoom <= mission.zoom.max; ++zoom) {
    for (const TileKey& key : required_tiles(mission, zoom)) {
      Sidecar tile;
      tile.key = key;
      tile.captured_at = test::kJudged;
      tile.gsd_mm = 300;
      tiles.push_back(tile);
    }
  }
  return tiles;
}

// The oracle: each pixel centre through the full projection, one by one.
std::uint64_t needed_pixels_brute_force(const Mission& mission, const TileKey& key) {
  const LocalFrame frame = mission_frame(mission);
  const Region region = required_region(mission, frame);
  std::uint64_t count = 0;
  for (int row = 0; row < 256; ++row) {
    for (int column = 0; column < 256; ++column) {
      const LonLat place = lonlat_from_pixel({key.x * 256.0 + column + 0.5, key.y * 256.0 + row + 0.5}, key.z);
      const PlanePoint enu = frame.plane_from_lonlat(place);
      count += region.contains(enu) ? 1U : 0U;
    }
  }
  return count;
}

TEST(CoverageRequirement, CountsTheSamePixelsAsBruteForce) {
  const Mission mission = sample_mission();
  const LocalFrame frame = mission_frame(mission);
  const CoverageRequirement need(required_region(mission, frame));
  for (int zoom = 17; zoom <= 18; ++zoom) {
    const TileKey middle = tile_at(mission.takeoff, zoom);
    for (std::uint32_t x = middle.x - 2; x <= middle.x + 3; ++x) {
      for (std::uint32_t y = middle.y - 2; y <= middle.y + 2; ++y) {
        const TileKey key{static_cast<std::uint8_t>(zoom), x, y};
        const auto expected = static_cast<double>(needed_pixels_brute_force(mission, key));
        const auto found = static_cast<double>(need.missing_pixels(TileFootprint(frame, key), {}));
        // Interpolating between corners moves an edge by micrometres: a pixel centre may fall on its other side.
        EXPECT_NEAR(found, expected, 2) << to_text(key);
        EXPECT_EQ(need.needs(TileFootprint(frame, key)), found > 0);
      }
    }
  }
}

TEST(MissionCheck, RequiredTilesAreThoseThatTouchTheRegion) {
  const Mission mission = sample_mission();
  const std::vector<TileKey> keys = required_tiles(mission, 18);
  EXPECT_TRUE(std::is_sorted(keys.begin(), keys.end()));
  const TileKey middle = tile_at(mission.takeoff, 18);
  for (std::uint32_t x = middle.x - 4; x <= middle.x + 6; ++x) {
    for (std::uint32_t y = middle.y - 4; y <= middle.y + 4; ++y) {
      const TileKey key{18, x, y};
      EXPECT_EQ(std::binary_search(keys.begin(), keys.end(), key), needed_pixels_brute_force(mission, key) > 0)
          << to_text(key);
    }
  }
}

TEST(MissionCheck, CompleteCoverageHasNoGaps) {
  const Mission mission = sample_mission();
  EXPECT_TRUE(check_tile_requirements(mission, all_tiles(mission), 1000, test::kJudged).empty());
}

TEST(MissionCheck, EveryMissingTileIsAGap) {
  const Mission mission = sample_mission();
  const std::vector<Sidecar> tiles = all_tiles(mission);
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    std::vector<Sidecar> without = tiles;
    without.erase(without.begin() + static_cast<std::ptrdiff_t>(i));
    const Findings findings = check_coverage(mission, without);
    ASSERT_TRUE(findings.contains("coverage.gap")) << to_text(tiles[i].key);
    EXPECT_NE(findings.items()[1].where.find(to_text(tiles[i].key)), std::string::npos);
  }
}

TEST(MissionCheck, AnEmptySetIsOneGap) {
  const Mission mission = sample_mission();
  EXPECT_TRUE(check_coverage(mission, {}).contains("coverage.gap"));
}

// A tile at the edge may be empty where it is not required, and only there.
TEST(MissionCheck, CoverageIsByAreaNotByTile) {
  const Mission mission = sample_mission();
  const LocalFrame frame = mission_frame(mission);
  const Region region = required_region(mission, frame);
  std::vector<Sidecar> tiles = all_tiles(mission);
  for (Sidecar& tile : tiles) {
    if (tile.key.z != 18) continue;
    Bytes mask(kPixels);
    const TileFootprint footprint(frame, tile.key);
    std::size_t valid = 0;
    for (int row = 0; row < 256; ++row) {
      for (int column = 0; column < 256; ++column) {
        const bool needed = region.contains(footprint.place(column + 0.5, row + 0.5));
        mask[static_cast<std::size_t>(row * 256 + column)] = needed ? 255 : 0;
        valid += needed ? 1U : 0U;
      }
    }
    if (valid == kPixels) continue;
    tile.valid_ppm = static_cast<std::int64_t>(valid * 1'000'000 / kPixels);
    tile.mask = encode_tile_mask(mask);
  }
  EXPECT_TRUE(check_coverage(mission, tiles).empty());

  for (Sidecar& tile : tiles) {
    if (tile.mask.empty()) continue;
    Bytes mask = decode_tile_mask(tile.mask).value();
    *std::find(mask.begin(), mask.end(), 255) = 0;  // one needed pixel
    tile.mask = encode_tile_mask(mask);
    break;
  }
  EXPECT_TRUE(check_coverage(mission, tiles).contains("coverage.gap"));
}

// A mask that cannot be read proves nothing.
TEST(MissionCheck, AnUnreadableMaskIsAGap) {
  const Mission mission = sample_mission();
  std::vector<Sidecar> tiles = all_tiles(mission);
  tiles.back().valid_ppm = 999'999;
  tiles.back().mask = {1, 2, 3};
  EXPECT_TRUE(check_coverage(mission, tiles).contains("coverage.gap"));
  tiles.back().mask.clear();
  EXPECT_TRUE(check_coverage(mission, tiles).contains("coverage.gap"));
}

TEST(MissionCheck, TheStrictestSectorGovernsFreshnessAndTheCorridorIsActive) {
  const Mission mission = sample_mission();
  std::vector<Sidecar> tiles = all_tiles(mission);
  const auto aged = [&](int days) {
    for (Sidecar& tile : tiles) tile.captured_at = {test::kJudged.unix_s - days * 86'400L};
    return check_freshness(mission, tiles, test::kJudged);
  };
  EXPECT_TRUE(aged(90).empty());
  // The corridor leaves the stable sector: its tiles outside are active.
  const Findings corridor = aged(91);
  ASSERT_EQ(corridor.items().size(), 1U);
  EXPECT_NE(corridor.items()[0].where.find("corridor"), std::string::npos);
  EXPECT_EQ(aged(730).items().size(), 1U);
  EXPECT_EQ(aged(731).items().size(), 2U);
}

TEST(MissionCheck, ChecksTheResolutionOfTheFinestZoom) {
  const Mission mission = sample_mission();
  std::vector<Sidecar> tiles = all_tiles(mission);
  tiles.front().gsd_mm = 9000;  // an overview
  EXPECT_TRUE(check_resolution(mission, tiles).empty());
  tiles.back().gsd_mm = 501;
  EXPECT_TRUE(check_resolution(mission, tiles).contains("resolution.coarse"));
}

TEST(MissionCheck, BudgetIsInMillionsOfBytes) {
  const Mission mission = sample_mission();
  EXPECT_TRUE(check_budget(mission, 20'000'000).empty());
  EXPECT_TRUE(check_budget(mission, 20'000'001).contains("budget.exceeded"));
}

TEST(TileMask, RoundTripsAndRejectsOtherImages) {
  Random random(3);
  Bytes pixels(kPixels);
  for (auto& pixel : pixels) pixel = random.chance(0.5) ? 255 : 0;
  EXPECT_EQ(decode_tile_mask(encode_tile_mask(pixels)), pixels);
  EXPECT_EQ(encode_tile_mask(pixels), encode_tile_mask(pixels));
  EXPECT_FALSE(decode_tile_mask({}));
  EXPECT_FALSE(decode_tile_mask(test::noise_tile(1)));  // a JPEG
  Bytes truncated = encode_tile_mask(pixels);
  truncated.resize(truncated.size() / 2);
  EXPECT_FALSE(decode_tile_mask(truncated));
}

}  // namespace
}  // namespace nadir
