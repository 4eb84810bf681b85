// Land of known shape under frames of known poses: whether the shape is found, and what must not become one.
#include "ortho/surface_model.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using Shape = std::function<double(PlanePoint)>;

constexpr double kUp_m = 100;  // of all cameras, over the plane
constexpr double kRoof_m = 6;  // over the land around it
constexpr double kHill_m = 9;

constexpr double kMost_m = 16;  // of all shapes, up and down, where they are seen
constexpr double kStep_m = 1;   // down a ray; a roof's edge is met as sharply as that is of its height

double level(PlanePoint) { return 0; }
double hill(PlanePoint at) { return kHill_m * std::exp(-(at - PlanePoint{0, 0}).squaredNorm() / (2 * 35.0 * 35.0)); }
bool on_roof(PlanePoint at) { return std::abs(at.east_m + 20) < 14 && std::abs(at.north_m - 10) < 14; }
double roof(PlanePoint at) { return on_roof(at) ? kRoof_m : 0; }
double slope(PlanePoint at) { return 0.1 * at.east_m; }

class Slope final : public GroundSurface {
  double height_m(PlanePoint point) const override { return slope(point); }
  double relief_sigma_m() const override { return 1; }
};

class SurfaceOfFrames : public ::testing::Test {
 protected:
  struct Taken {
    CameraPose over_plane;  // its height is over the plane, as the picture is made
    cv::Mat picture;
  };

  // Along the ray to where a pixel would see level ground, the first place that is as high as the land.
  static PlanePoint met(const CameraPose& pose, PlanePoint on_plane, const Shape& shape) {
    const Eigen::Vector2d aside = on_plane - pose.position;
    const auto at = [&](double down_m) { return pose.position + Eigen::Vector2d(aside * (down_m / pose.agl_m)); };
    const auto above = [&](double down_m) { return pose.agl_m - down_m > shape(at(down_m)); };
    double low_m = pose.agl_m - kMost_m;
    while (low_m < pose.agl_m + kMost_m && above(low_m + kStep_m)) low_m += kStep_m;
    double high_m = low_m + kStep_m;
    for (int i = 0; i < 6; ++i) (above((low_m + high_m) / 2) ? low_m : high_m) = (low_m + high_m) / 2;
    return at(low_m);
  }
  Taken taken(PlanePoint position, const Shape& shape, double heading_rad = 0, double pitch_rad = 0) const {
    const CameraPose pose{position, kUp_m, {heading_rad, pitch_rad, 0}};
    const auto seen = [&](PlanePoint on_plane) { return land_.grey(met(pose, on_plane, shape)); };
    return {pose, test::photograph(seen, camera_, pose)};
  }
  // Two passes of four frames; made once for each shape.
  const std::vector<Taken>& survey(double (*shape)(PlanePoint)) const {
    static std::map<double (*)(PlanePoint), std::vector<Taken>> made;
    std::vector<Taken>& frames = made[shape];
    if (!frames.empty()) return frames;
    for (const double north : {-35.0, 35.0}) {
      for (const double east : {-75.0, -25.0, 25.0, 75.0}) {
        frames.push_back(taken({east, north}, shape, north > 0 ? 0.4 : -0.1, 0.03));
      }
    }
    return frames;
  }
  SurfaceModel found(const std::vector<Taken>& frames, const GroundSurface& terrain) {
    std::vector<std::optional<CameraPose>> poses;
    for (const Taken& frame : frames) {
      poses.emplace_back(frame.over_plane);
      poses.back()->agl_m -= terrain.height_m(frame.over_plane.position);
    }
    NoProgress progress;
    return surface_from_frames(
        camera_, terrain, poses, [&](std::size_t i) { return frames[i].picture; }, progress, &figures_);
  }

  static inline const test::Landscape land_{17, 250};
  CameraModel camera_ = test::small_camera();
  FlatGround flat_;
  SurfaceModelFigures figures_;
};

TEST_F(SurfaceOfFrames, FindsAHill) {
  const SurfaceModel surface = found(survey(hill), flat_);
  double squares = 0;
  int places = 0;
  for (double east = -60; east <= 60; east += 10) {
    for (double north = -40; north <= 40; north += 10) {
      const double off_m = surface.height_m({east, north}) - hill({east, north});
      EXPECT_LT(std::abs(off_m), 1.5) << east << " " << north;
      squares += off_m * off_m, ++places;
    }
  }
  EXPECT_LT(std::sqrt(squares / places), 0.5);
  EXPECT_GT(figures_.pairs, 7U);
  EXPECT_LT(figures_.along_px, 0.3) << "what the round before left";
  EXPECT_LT(figures_.across_px, 0.3);
  EXPECT_EQ(0, surface.height_m({900, 900})) << "where nobody looked, the terrain";
}

TEST_F(SurfaceOfFrames, FramesClosePastEachOtherAreComparedWithThoseFartherOn) {
  std::vector<Taken> frames;
  for (double east = -40; east <= 40; east += 4) frames.push_back(taken({east, 0}, hill));
  const SurfaceModel surface = found(frames, flat_);
  for (const PlanePoint at : {PlanePoint{0, 0}, PlanePoint{-25, 10}, PlanePoint{20, -20}}) {
    EXPECT_NEAR(hill(at), surface.height_m(at), 1.5) << at.east_m << " " << at.north_m;
  }
}

TEST_F(SurfaceOfFrames, LiftsARoofAndNotTheLandAroundIt) {
  const SurfaceModel surface = found(survey(roof), flat_);
  EXPECT_NEAR(kRoof_m, surface.height_m({-20, 10}), 1);
  for (const PlanePoint beside : {PlanePoint{-20, -40}, PlanePoint{-60, 10}, PlanePoint{30, 10}, PlanePoint{-20, 45}}) {
    EXPECT_NEAR(0, surface.height_m(beside), 0.7) << beside.east_m << " " << beside.north_m;
  }
}

TEST_F(SurfaceOfFrames, LeavesLevelLandLevel) {
  const SurfaceModel surface = found(survey(level), flat_);
  for (double east = -60; east <= 60; east += 6) {
    for (double north = -40; north <= 40; north += 6) {
      EXPECT_NEAR(0, surface.height_m({east, north}), 0.6) << east << " " << north;
    }
  }
}

TEST_F(SurfaceOfFrames, KeepsTheTerrainThatIsKnown) {
  const Slope terrain;
  const SurfaceModel surface = found(survey(slope), terrain);
  for (const PlanePoint at : {PlanePoint{-50, 0}, PlanePoint{0, 20}, PlanePoint{50, -20}}) {
    EXPECT_NEAR(slope(at), surface.height_m(at), 0.6);
  }
  EXPECT_EQ(slope({900, 900}), surface.height_m({900, 900}));
  EXPECT_EQ(1, surface.relief_sigma_m());
}

TEST_F(SurfaceOfFrames, ACameraStaysWhereItIs) {
  const SurfaceModel surface = found(survey(hill), flat_);
  const CameraPose pose{{5, -5}, 80, {1, 0.1, 0.2}};
  const CameraPose restated = surface.over_surface(pose);
  EXPECT_NEAR(80, restated.agl_m + surface.height_m(pose.position), 1e-9);
  EXPECT_LT(restated.agl_m, 75);
  EXPECT_EQ(pose.position.east_m, restated.position.east_m);
  EXPECT_EQ(pose.attitude.heading_rad, restated.attitude.heading_rad);
}

TEST_F(SurfaceOfFrames, WhatHasNoTextureHasNoHeight) {
  std::vector<Taken> frames = survey(hill);
  for (Taken& frame : frames) frame.picture = cv::Mat(frame.picture.size(), CV_8UC1, cv::Scalar(127));
  const SurfaceModel surface = found(frames, flat_);
  EXPECT_EQ(0U, figures_.measured);
  EXPECT_EQ(0, surface.height_m({0, 0}));
}

TEST_F(SurfaceOfFrames, WhatMovedAcrossIsNoHeight) {
  // Bases to the east; the second picture is of a place three metres to the south of what its pose says.
  std::vector<Taken> frames = {taken({-20, 0}, level), taken({20, -3}, level)};
  frames[1].over_plane.position.north_m = 0;
  const SurfaceModel surface = found(frames, flat_);
  EXPECT_EQ(0U, figures_.measured);
  EXPECT_NEAR(0, surface.height_m({0, 0}), 0.5) << "of coarse pixels it moved little";
}

TEST_F(SurfaceOfFrames, SameFramesGiveTheSameBits) {
  const std::vector<Taken>& frames = survey(hill);
  const SurfaceModel one = found(frames, flat_), other = found(frames, flat_);
  EXPECT_LT(5, one.height_m({0, 11}));
  for (double east = -90; east <= 90; east += 3.7) {
    EXPECT_EQ(one.height_m({east, 11}), other.height_m({east, 11}));
  }
}

TEST_F(SurfaceOfFrames, NothingToCompareLeavesTheTerrain) {
  const Taken &one = survey(hill)[1], &next = survey(hill)[2];
  const auto with_next = [&](auto change) {
    std::vector<Taken> frames = {one, next};
    change(frames[1]);
    return found(frames, flat_).height_m({0, 0});
  };
  EXPECT_LT(2, with_next([](Taken&) {}));
  EXPECT_EQ(0, with_next([](Taken& frame) { frame.over_plane.position.east_m = 2000; }));
  EXPECT_EQ(0, with_next([](Taken& frame) { frame.picture = cv::Mat(); })) << "a picture that was lost";
  EXPECT_EQ(0, with_next([](Taken& frame) { frame.over_plane.agl_m = 9000; })) << "from far above";
  EXPECT_EQ(0, with_next([](Taken& frame) { frame.over_plane.agl_m = -20; })) << "from below";
  EXPECT_EQ(0, with_next([](Taken& frame) { frame.over_plane.attitude.pitch_rad = 1.4; })) << "towards the horizon";
  EXPECT_EQ(0, found({one}, flat_).height_m({0, 0}));
  EXPECT_EQ(0, found({}, flat_).height_m({0, 0}));
}

TEST_F(SurfaceOfFrames, EndlessPlacesAreTheTerrains) {
  const SurfaceModel surface = found(survey(hill), flat_);
  EXPECT_EQ(0, surface.height_m({1e300, -1e300}));
  EXPECT_EQ(0, surface.height_m({std::nan(""), 0}));
}

}  // namespace
}  // namespace nadir
