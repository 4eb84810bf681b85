// The oracle is PROJ (EPSG:3857), which shares no code with ours.
#include "geodesy/web_mercator.hpp"

#include <gtest/gtest.h>
#include <proj.h>

#include <array>
#include <cmath>
#include <memory>

#include "base/random.hpp"

namespace nadir {
namespace {

class Proj {
 public:
  Proj() : context_(proj_context_create()) {
    proj_context_set_enable_network(context_, 0);
    PJ* raw = proj_create_crs_to_crs(context_, "EPSG:4326", "EPSG:3857", nullptr);
    transform_ = proj_normalize_for_visualization(context_, raw);
    proj_destroy(raw);
  }
  ~Proj() {
    proj_destroy(transform_);
    proj_context_destroy(context_);
  }
  Proj(const Proj&) = delete;
  Proj& operator=(const Proj&) = delete;

  MercatorXY mercator(LonLat place) const {
    const PJ_COORD out = proj_trans(transform_, PJ_FWD, proj_coord(place.lon_deg, place.lat_deg, 0, 0));
    return {out.xy.x, out.xy.y};
  }
  LonLat lonlat(MercatorXY point) const {
    const PJ_COORD out = proj_trans(transform_, PJ_INV, proj_coord(point.x_m, point.y_m, 0, 0));
    return {out.xy.x, out.xy.y};
  }

 private:
  PJ_CONTEXT* context_;
  PJ* transform_;
};

std::vector<LonLat> some_places() {
  std::vector<LonLat> places{{0, 0}, {120.720208, 24.262133}, {-83.3, 41.03}, {179.999, -84.9}, {-180, 85}};
  Random random(5);
  for (int i = 0; i < 500; ++i) places.push_back({random.uniform(-180, 180), random.uniform(-85, 85)});
  return places;
}

TEST(WebMercator, AgreesWithProj) {
  const Proj proj;
  for (const LonLat place : some_places()) {
    const MercatorXY ours = mercator_from_lonlat(place), theirs = proj.mercator(place);
    EXPECT_NEAR(ours.x_m, theirs.x_m, 1e-6);
    EXPECT_NEAR(ours.y_m, theirs.y_m, 1e-6);
    const LonLat back = lonlat_from_mercator(ours), their_back = proj.lonlat(theirs);
    EXPECT_NEAR(back.lon_deg, their_back.lon_deg, 1e-11);
    EXPECT_NEAR(back.lat_deg, their_back.lat_deg, 1e-11);
  }
}

// The tile of a place, computed from PROJ's metres by the definition of the grid.
TEST(WebMercator, TilesAgreeWithProj) {
  const Proj proj;
  constexpr double kHalf = 20037508.342789244;
  for (const LonLat place : some_places()) {
    for (const int zoom : {0, 1, 11, 19, 24}) {
      const MercatorXY m = proj.mercator(place);
      const double across = std::ldexp(1.0, zoom), tile = 2 * kHalf / across;
      const double x = std::clamp(std::floor((m.x_m + kHalf) / tile), 0.0, across - 1);
      const double y = std::clamp(std::floor((kHalf - m.y_m) / tile), 0.0, across - 1);
      const TileKey key = tile_at(place, zoom);
      EXPECT_EQ(key.x, static_cast<std::uint32_t>(x));
      EXPECT_EQ(key.y, static_cast<std::uint32_t>(y));
    }
  }
}

TEST(WebMercator, TileBoundsContainThePoint) {
  for (const LonLat place : some_places()) {
    const LonLatBox box = bounds_of(tile_at(place, 17));
    EXPECT_LE(box.west_deg, place.lon_deg + 1e-12);
    EXPECT_GE(box.east_deg, place.lon_deg - 1e-12);
    EXPECT_LE(box.south_deg, place.lat_deg + 1e-12);
    EXPECT_GE(box.north_deg, place.lat_deg - 1e-12);
  }
}

TEST(WebMercator, PixelsRoundTrip) {
  for (const LonLat place : some_places()) {
    const LonLat back = lonlat_from_pixel(pixel_from_lonlat(place, 19), 19);
    EXPECT_NEAR(back.lon_deg, place.lon_deg, 1e-10);
    EXPECT_NEAR(back.lat_deg, place.lat_deg, 1e-10);
  }
  EXPECT_NEAR(mercator_pixel_m(0), 156543.03392804097, 1e-6);
}

// On the ground a pixel is as wide as the parallel's circumference says.
TEST(WebMercator, GroundResolutionIsThatOfTheParallel) {
  for (const double lat_deg : {0.0, 24.26, 47.0, 70.0}) {
    const double lat = lat_deg * M_PI / 180, e2 = 0.00669437999014;
    const double parallel_m = 2 * M_PI * 6378137.0 / std::sqrt(1 - e2 * std::sin(lat) * std::sin(lat)) * std::cos(lat);
    EXPECT_NEAR(ground_resolution_m(19, lat_deg), parallel_m / std::ldexp(256.0, 19), 1e-9);
  }
}

TEST(WebMercator, TheEdgeOfTheWorldBelongsToTheLastTile) {
  EXPECT_EQ(tile_at({180, -90}, 3), (TileKey{3, 7, 7}));
  EXPECT_EQ(tile_at({-180, 90}, 3), (TileKey{3, 0, 0}));
}

// The MBTiles 1.3 specification's own example: "the tile 11/327/791 is inserted as 11, 327, 1256".
TEST(TileKey, MbtilesSpecificationsExample) {
  const TileKey key{11, 327, 791};
  EXPECT_EQ(key.tms_row(), 1256U);
  EXPECT_EQ(TileKey::from_tms(11, 327, 1256), key);
}

TEST(TileKey, TmsIsItsOwnInverseAtEveryZoom) {
  for (std::uint8_t z = 0; z <= kMaxZoom; ++z) {
    const std::uint32_t last = (std::uint32_t{1} << z) - 1;
    EXPECT_EQ((TileKey{z, 0, 0}).tms_row(), last);
    EXPECT_EQ(TileKey::from_tms(z, 0, last), (TileKey{z, 0, 0}));
  }
}

TEST(TileKey, RecognizesValidAddresses) {
  EXPECT_TRUE((TileKey{0, 0, 0}).valid());
  EXPECT_FALSE((TileKey{0, 1, 0}).valid());
  EXPECT_TRUE((TileKey{24, (1U << 24U) - 1, 0}).valid());
  EXPECT_FALSE((TileKey{25, 0, 0}).valid());
  EXPECT_EQ((TileKey{5, 9, 12}).parent(), (TileKey{4, 4, 6}));
}

TEST(TileKey, AcceptsOneSpellingOnly) {
  const TileKey key{19, 438048, 225763};
  EXPECT_EQ(to_text(key), "19/438048/225763");
  EXPECT_EQ(parse_tile_key("19/438048/225763"), key);
  for (const char* bad : {"", "19/1", "19/1/2/3", "19/-1/2", "19/1/2 ", "2/4/0", "2/0/4", "25/0/0", "a/b/c", "19//2",
                          "19/01/2", "300/0/0", "19/4294967297/0"}) {
    EXPECT_EQ(parse_tile_key(bad), std::nullopt) << bad;
  }
}

TEST(TileKey, SortsByZoomColumnRow) {
  EXPECT_LT((TileKey{1, 1, 1}), (TileKey{2, 0, 0}));
  EXPECT_LT((TileKey{2, 0, 3}), (TileKey{2, 1, 0}));
}

}  // namespace

}  // namespace nadir
