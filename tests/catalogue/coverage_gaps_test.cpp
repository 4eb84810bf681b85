#include "catalogue/coverage_gaps.hpp"

#include <gtest/gtest.h>

#include "catalogue/geometry.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/coverage_gaps.hpp"
#include "package/tile_image.hpp"

namespace nadir {
namespace {

constexpr std::size_t kPixels = static_cast<std::size_t>(kTileSize) * kTileSize;
constexpr TileKey kKey{18, 139'000, 90'000};

GeoRing square(const TileKey& key, int from, int to) {
  GeoRing ring;
  for (const auto& [column, row] : {std::pair(from, from), {to, from}, {to, to}, {from, to}, {from, from}}) {
    ring.push_back(place_of(key, {column, row}));
  }
  return ring;
}

std::int64_t count(const Bytes& pixels) { return std::count(pixels.begin(), pixels.end(), std::uint8_t{255}); }

TEST(PixelCover, HolesOverlapsAndNeighbours) {
  PixelCover cover(18, kKey.y, kKey.y);
  EXPECT_EQ(count(cover.pixels(kKey)), 0);
  cover.add(GeoArea{GeoPolygon{square(kKey, 10, 110), square(kKey, 20, 30)}});
  EXPECT_EQ(count(cover.pixels(kKey)), 100 * 100 - 10 * 10);
  cover.add(GeoArea{GeoPolygon{square(kKey, 60, 160)}});  // overlaps: a union, not a sum
  EXPECT_EQ(count(cover.pixels(kKey)), 100 * 100 - 10 * 10 + 100 * 100 - 50 * 50);
  EXPECT_EQ(count(cover.pixels({18, kKey.x + 1, kKey.y})), 0);
  EXPECT_EQ(count(cover.pixels({18, kKey.x, kKey.y + 1})), 0) << "outside of its tile rows";
}

TEST(PixelCover, FootprintsRasterizeToTheirMasks) {
  // Tiles of a column, one with a mask full of holes and corner touches: vectorized and rasterized again, every pixel
  // is the same.
  Bytes mask(kPixels, 255);
  for (std::size_t i = 0; i < kPixels; ++i) {
    const std::size_t block = (i / 256 / 16) * 31 + (i % 256 / 16) * 17;
    if (block % 3 == 0) mask[i] = 0;
  }
  std::vector<Sidecar> tiles(4);
  for (std::uint32_t i = 0; i < 4; ++i) tiles[i].key = {18, kKey.x, kKey.y + i};
  tiles[1].valid_ppm = 600'000;
  tiles[1].mask = encode_tile_mask(mask);
  tiles[3].valid_ppm = 0;
  std::vector<const Sidecar*> pointers;
  for (const Sidecar& tile : tiles) pointers.push_back(&tile);
  PixelCover cover(18, kKey.y, kKey.y + 3);
  cover.add(footprint_of(pointers));
  EXPECT_EQ(count(cover.pixels(tiles[0].key)), static_cast<std::int64_t>(kPixels));
  EXPECT_EQ(cover.pixels(tiles[1].key), mask);
  EXPECT_EQ(count(cover.pixels(tiles[2].key)), static_cast<std::int64_t>(kPixels));
  EXPECT_EQ(count(cover.pixels(tiles[3].key)), 0);
}

TEST(PixelCover, OtherZooms) {
  const GeoArea area{area_of(kKey)};
  PixelCover coarser(17, kKey.y / 2, kKey.y / 2), finer(19, kKey.y * 2, kKey.y * 2 + 1);
  coarser.add(area);
  finer.add(area);
  EXPECT_EQ(count(coarser.pixels(kKey.parent())), 128 * 128);
  EXPECT_EQ(count(finer.pixels({19, kKey.x * 2 + 1, kKey.y * 2 + 1})), static_cast<std::int64_t>(kPixels));
  EXPECT_EQ(count(finer.pixels({19, kKey.x * 2 + 2, kKey.y * 2})), 0);
}

}  // namespace
}  // namespace nadir
