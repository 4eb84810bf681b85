#include "ortho/eligibility.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>

namespace nadir {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

FramePose good() {
  FramePose pose;
  pose.pose.agl_m = 120;
  pose.sigma_m = 2;
  pose.source = SourceLabel::satellite_anchored;
  pose.confirmed = true;
  return pose;
}

FrameEligibility judged(const FramePose& pose, double frame_gsd_m = 0.1) {
  return check_pose_eligible(pose, frame_gsd_m, 0.2, {});
}

TEST(Eligibility, GradesBySigma) {
  FramePose pose = good();
  EXPECT_FALSE(judged(pose).refusal);
  EXPECT_EQ(judged(pose).trust, CandidateTrust::candidate);
  pose.sigma_m = 3;
  EXPECT_EQ(judged(pose).trust, CandidateTrust::candidate);
  pose.sigma_m = 3.01;
  EXPECT_FALSE(judged(pose).refusal);
  EXPECT_EQ(judged(pose).trust, CandidateTrust::soft);
  for (const double sigma_m : {5.01, 0.0, -1.0, kNan, 1e9}) {
    pose.sigma_m = sigma_m;
    EXPECT_EQ(judged(pose).refusal, OrthoRefusal::unsure) << sigma_m;
  }
}

TEST(Eligibility, RequiresACurrentAnchor) {
  FramePose pose = good();
  for (const auto source : {SourceLabel::vo_extrapolated, SourceLabel::dead_reckoned, SourceLabel::no_fix}) {
    pose.source = source;
    EXPECT_EQ(judged(pose).refusal, OrthoRefusal::not_anchored);
  }
  pose = good();
  for (const double age_s : {0.51, 30.0, -1.0, kNan}) {
    pose.anchor_age_s = age_s;
    EXPECT_EQ(judged(pose).refusal, OrthoRefusal::not_anchored) << age_s;
  }
  pose = good();
  pose.confirmed = false;
  EXPECT_EQ(judged(pose).refusal, OrthoRefusal::unconfirmed);
}

TEST(Eligibility, RejectsFramesMuchCoarserThanTheTiles) {
  EXPECT_FALSE(judged(good(), 0.4).refusal);
  for (const double gsd_m : {0.41, 0.0, kNan}) EXPECT_EQ(judged(good(), gsd_m).refusal, OrthoRefusal::too_coarse);
}

TEST(Eligibility, RejectsBlurredFrames) {
  FrameQuality quality{.mean = 120, .contrast = 40, .clipped_share = 0, .sharpness = 0.06, .usable = true};
  EXPECT_FALSE(check_image_eligible(quality, {}));
  quality.sharpness = 0.01;
  EXPECT_EQ(check_image_eligible(quality, {}), OrthoRefusal::frame_unfit);
  quality.sharpness = 0.06;
  quality.contrast = 3;
  EXPECT_EQ(check_image_eligible(quality, {}), OrthoRefusal::frame_unfit)
      << "the map may be matched at dusk, tiles are not made";
  quality.contrast = 40;
  quality.usable = false;
  EXPECT_EQ(check_image_eligible(quality, {}), OrthoRefusal::frame_unfit);
}

TEST(Eligibility, RejectsSteepGroundAndLargeViewAngles) {
  TileProjection view;
  EXPECT_FALSE(check_view_eligible(view, {}));
  view.view_angle_rad = 0.7;
  EXPECT_EQ(check_view_eligible(view, {}), OrthoRefusal::oblique);
  view.view_angle_rad = kNan;
  EXPECT_EQ(check_view_eligible(view, {}), OrthoRefusal::oblique);
  view = {};
  view.slope = 0.3;
  EXPECT_EQ(check_view_eligible(view, {}), OrthoRefusal::steep);
  view.slope = kNan;
  EXPECT_EQ(check_view_eligible(view, {}), OrthoRefusal::steep);
}

cv::Mat chequered(const cv::Scalar& one, const cv::Scalar& other, int size) {
  cv::Mat tile(kTileSize, kTileSize, CV_8UC3, one);
  for (int r = 0; r < kTileSize; r += size) {
    for (int c = (r / size % 2) * size; c < kTileSize; c += 2 * size) {
      tile(cv::Rect(c, r, size, size)).setTo(other);
    }
  }
  return tile;
}

TEST(Eligibility, MeasuresTiles) {
  const TilePixels pixels = measure_tile(chequered(cv::Scalar::all(60), cv::Scalar::all(180), 16));
  EXPECT_NEAR(pixels.contrast, 60.0 / 255, 1e-6);
  EXPECT_EQ(pixels.clipped_share, 0);
  EXPECT_EQ(pixels.cloud_share, 0);
  EXPECT_FALSE(check_tile_eligible(pixels, {}));
}

TEST(Eligibility, RejectsBlankClippedOrCloudedTiles) {
  const auto judge = [](const cv::Mat& tile) { return check_tile_eligible(measure_tile(tile), {}); };
  EXPECT_EQ(judge(cv::Mat(kTileSize, kTileSize, CV_8UC3, cv::Scalar::all(90))), OrthoRefusal::low_contrast);
  EXPECT_EQ(judge(cv::Mat(kTileSize, kTileSize, CV_8UC3, cv::Scalar::all(0))), OrthoRefusal::clipped);
  EXPECT_EQ(judge(chequered(cv::Scalar::all(120), cv::Scalar::all(255), 16)), OrthoRefusal::clipped);
  cv::Mat cloud = chequered(cv::Scalar(60, 90, 80), cv::Scalar(50, 70, 70), 4);
  cloud.rowRange(0, 128).setTo(cv::Scalar(228, 226, 225));
  EXPECT_NEAR(measure_tile(cloud).cloud_share, 0.5, 0.05);
  EXPECT_EQ(judge(cloud), OrthoRefusal::clouded);
  cv::Mat roof = chequered(cv::Scalar(60, 90, 80), cv::Scalar(50, 70, 70), 4);
  roof(cv::Rect(20, 20, 60, 60)).setTo(cv::Scalar(228, 226, 225));
  EXPECT_FALSE(judge(roof)) << "a bright roof is no cloud";
}

TEST(Eligibility, EveryRejectionHasAName) {
  std::set<std::string_view> names;
  for (int i = 0; i < kOrthoRefusals; ++i) names.insert(name_of(static_cast<OrthoRefusal>(i)));
  EXPECT_EQ(names.size(), static_cast<std::size_t>(kOrthoRefusals));
}

}  // namespace
}  // namespace nadir
