#include "ortho/orthorectifier.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using test::bent_camera;
using test::coordinates;
using test::seen_by_pixel;
using test::small_camera;

const LocalFrame& plane() {
  static const LocalFrame frame({11.2, 48.1});
  return frame;
}

constexpr int kFineZoom = 20;  // 0.1 m: 256 pixels are 26 m

// The place of a tile's pixel by the textbook's Mercator.
PlanePoint place_of(const TileKey& key, double column, double row) {
  const double across = std::ldexp(256.0, key.z);
  const double x = (key.x * 256.0 + column + 0.5) / across, y = (key.y * 256.0 + row + 0.5) / across;
  return plane().plane_from_lonlat({x * 360 - 180, degrees(std::atan(std::sinh(kPi * (1 - 2 * y))))});
}

class Hills final : public GroundSurface {
 public:
  explicit Hills(double height_m) : height_m_(height_m) {}
  double height_m(PlanePoint at) const override {
    return height_m_ * std::sin(at.east_m / 25) * std::cos(at.north_m / 31);
  }
  double relief_sigma_m() const override { return 1; }

 private:
  double height_m_;
};

struct Case {
  const char* name;
  CameraModel camera;
  CameraPose pose;
};

std::vector<Case> cases() {
  return {{"level", small_camera(), {{30, -20}, 100, {}}},
          {"turned and tilted", small_camera(), {{-5, 8}, 100, {radians(133), radians(8), radians(-11)}}},
          {"bent lens", bent_camera(), {{0, 0}, 100, {radians(45), radians(5), radians(5)}}},
          {"banked", bent_camera(), {{700, -300}, 80, {radians(-60), radians(2), radians(12)}}}};
}

// The oracle is a ray caster of its own (vision/synthetic_ground.hpp): the frame's pixel that a tile's pixel was taken
// from must see the place of the tile's pixel.
TEST(Orthorectifier, SamplesEachPixelWhereTheCameraSawIt) {
  for (const Case& test : cases()) {
    SCOPED_TRACE(test.name);
    const auto projected = whole_tiles(kFineZoom, plane(), test.camera, test.pose, FlatGround());
    ASSERT_GE(projected.size(), 4U);
    double worst_m = 0;
    for (const OrthoTile& tile : orthorectify({coordinates(test.camera), test.camera}, projected)) {
      for (int r = 0; r < kTileSize; r += 5) {
        for (int c = 0; c < kTileSize; c += 5) {
          const auto& from = tile.image.at<cv::Vec2f>(r, c);
          const PlanePoint seen =
              seen_by_pixel(test.camera, test.pose, static_cast<double>(from[0]), static_cast<double>(from[1]));
          const PlanePoint expected = place_of(tile.key, c, r);
          worst_m = std::max(worst_m, distance_m(seen, expected));
        }
      }
    }
    // OpenCV's remap knows coordinates to 1/32 pixel; a frame's pixel is 0.4 to 0.5 m here.
    EXPECT_LT(worst_m, 0.06);
  }
}

TEST(Orthorectifier, BetweenTheNodesErrsLessThanATenthOfAPixelOverTerrainAndLens) {
  const Hills hills(4);
  for (const Case& test : cases()) {
    SCOPED_TRACE(test.name);
    double worst_px = 0;
    int tiles = 0;
    for (const ProjectedTile& tile : whole_tiles(kFineZoom, plane(), test.camera, test.pose, hills)) {
      const std::vector<ProjectedTile> one{tile};
      const cv::Mat taken = orthorectify({coordinates(test.camera), test.camera}, one).front().image;
      for (int r = 0; r < kTileSize; r += 3) {
        for (int c = 0; c < kTileSize; c += 3) {
          const auto exact = frame_pixel_of(tile.key, c, r, plane(), test.camera, test.pose, hills);
          ASSERT_TRUE(exact);
          const auto& from = taken.at<cv::Vec2f>(r, c);
          worst_px = std::max(worst_px, std::hypot(static_cast<double>(from[0]) - exact->x(),
                                                   static_cast<double>(from[1]) - exact->y()));
        }
      }
      ++tiles;
    }
    EXPECT_GE(tiles, 4);
    EXPECT_LT(worst_px, 0.1);
  }
}

// Exactly the tiles all of whose pixels the frame shows, but for the pixel at its rim that interpolation needs.
TEST(Orthorectifier, MakesAllCompleteTiles) {
  const Hills hills(4);
  for (const Case& test : cases()) {
    SCOPED_TRACE(test.name);
    const auto made = whole_tiles(kFineZoom, plane(), test.camera, test.pose, hills);
    const auto least_inside = [&](const TileKey& key) {
      double least = 1e9;
      for (int i = 0; i < kTileSize; i += 3) {
        for (const auto& [c, r] : {std::pair{i, 0}, {i, 255}, {0, i}, {255, i}, {i, i}, {255 - i, i}}) {
          const auto at = frame_pixel_of(key, c, r, plane(), test.camera, test.pose, hills);
          if (!at) return -1e9;
          least =
              std::min({least, at->x(), at->y(), test.camera.width - 1 - at->x(), test.camera.height - 1 - at->y()});
        }
      }
      return least;
    };
    const TileKey middle = tile_at(plane().lonlat_from_plane(test.pose.position), kFineZoom);
    std::size_t expected = 0;
    for (std::uint32_t x = middle.x - 9; x <= middle.x + 9; ++x) {
      for (std::uint32_t y = middle.y - 9; y <= middle.y + 9; ++y) {
        const TileKey key{kFineZoom, x, y};
        const bool there = std::any_of(made.begin(), made.end(), [&](const auto& tile) { return tile.key == key; });
        const double inside = least_inside(key);
        const bool clear = inside >= 1.5 || inside < 0.9;
        EXPECT_TRUE(!clear || there == (inside >= 1.5)) << to_text(key) << " " << inside;
        expected += inside >= 1.5;
      }
    }
    EXPECT_GE(expected, 4U);
  }
}

TEST(Orthorectifier, MeasuresViewAngleAndSlope) {
  const CameraPose pose{{0, 0}, 100, {}};
  for (const ProjectedTile& tile : whole_tiles(kFineZoom, plane(), small_camera(), pose, FlatGround())) {
    double farthest_m = 0;
    for (const double c : {0.0, 256.0}) {
      for (const double r : {0.0, 256.0}) {
        const PlanePoint corner = place_of(tile.key, c, r);
        farthest_m = std::max(farthest_m, std::hypot(corner.east_m, corner.north_m));
      }
    }
    EXPECT_NEAR(tile.projection.view_angle_rad, std::atan(farthest_m / 100), 1e-3);
    EXPECT_EQ(tile.projection.slope, 0);
  }
  double steepest = 0;
  for (const ProjectedTile& tile : whole_tiles(kFineZoom, plane(), small_camera(), pose, Hills(20))) {
    steepest = std::max(steepest, tile.projection.slope);
  }
  EXPECT_NEAR(steepest, 20.0 / 25, 0.08) << "the steepest place of these hills";
}

TEST(Orthorectifier, IgnoresGroundNearTheHorizon) {
  for (const double pitch_deg : {50.0, 80.0, 90.0, 120.0, 180.0}) {
    const CameraPose pose{{0, 0}, 100, {0, radians(pitch_deg), 0}};
    EXPECT_TRUE(tiles_seen(kFineZoom, plane(), small_camera(), pose, FlatGround()).empty()) << pitch_deg;
  }
  const CameraPose high{{0, 0}, 100'000, {}};
  EXPECT_TRUE(tiles_seen(22, plane(), small_camera(), high, FlatGround()).empty()) << "millions of them";
  const double nan = std::nan("");
  EXPECT_TRUE(whole_tiles(kFineZoom, plane(), small_camera(), {{nan, 0}, 100, {}}, FlatGround()).empty());
  EXPECT_TRUE(whole_tiles(kFineZoom, plane(), small_camera(), {{0, 0}, nan, {}}, FlatGround()).empty());
  EXPECT_TRUE(whole_tiles(kFineZoom, plane(), small_camera(), {{0, 0}, 100, {nan, 0, 0}}, FlatGround()).empty());
}

// Stripes of one pixel, four times as fine as the tile's: averaged away, not turned into wide ones.
TEST(Orthorectifier, DoesNotAlias) {
  CameraModel camera = small_camera().scaled(8);
  cv::Mat stripes(camera.height, camera.width, CV_8UC3);
  for (int c = 0; c < camera.width; ++c) stripes.col(c).setTo(c % 2 == 0 ? cv::Scalar::all(0) : cv::Scalar::all(255));
  const CameraPose pose{{0, 0}, 100, {radians(10), 0, 0}};
  const double tile_gsd_m = 0.2;
  ASSERT_LT(gsd_at(camera, pose.agl_m) * 3, tile_gsd_m);
  const ReducedFrame reduced = reduce_frame(stripes, camera, pose.agl_m, tile_gsd_m);
  const auto tiles = orthorectify(reduced, whole_tiles(19, plane(), reduced.camera, pose, FlatGround()));
  ASSERT_FALSE(tiles.empty());
  for (const OrthoTile& tile : tiles) {
    cv::Scalar mean, deviation;
    cv::meanStdDev(tile.image, mean, deviation);
    EXPECT_NEAR(mean[0], 127.5, 3);
    EXPECT_LT(deviation[0], 25) << "aliased stripes have 127; an average over 2.5 pixels leaves 17";
  }
}

TEST(Orthorectifier, DecodesNoLargerThanNeeded) {
  const CameraModel camera = small_camera().scaled(8);  // 2560 x 1920
  const double gsd_m = gsd_at(camera, 100);
  EXPECT_EQ(decoding_shrink(camera, 100, gsd_m), 1);
  EXPECT_EQ(decoding_shrink(camera, 100, gsd_m * 2.5), 2);
  EXPECT_EQ(decoding_shrink(camera, 100, gsd_m * 5), 4);
  EXPECT_EQ(decoding_shrink(camera, 100, gsd_m * 100), 8);
  CameraModel odd = camera;
  odd.width += 1;
  EXPECT_EQ(decoding_shrink(odd, 100, gsd_m * 100), 1);
}

}  // namespace
}  // namespace nadir
