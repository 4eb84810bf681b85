// What every matcher must do: a known place is found with a covariance consistent with the error, and where the place
// is not, nothing is confident.
#include "vision/map_matcher.hpp"
#include "bench/flow_odometry.hpp"
#include "bench/keypoint_matcher.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "estimation/fault_maps.hpp"
#include "estimation/localizer_fixture.hpp"
#include "estimation/look_likelihood.hpp"
#include "support/cancel_after.hpp"
#include "vision/descriptor_matcher.hpp"
#include "vision/gradient_network.hpp"

namespace nadir {
namespace {

using namespace test;

struct Backend {
  const char* name;
  std::unique_ptr<MapMatcher> (*make)(const MatcherMap&);
};

class Matcher : public testing::TestWithParam<Backend> {
 protected:
  AnchorMatch match(const TileSource& tiles, const cv::Mat& grey, const AnchorPrior& prior) const {
    return GetParam().make(map(tiles))->match(grey, prior);
  }
  MatcherMap map(const TileSource& tiles) const { return {camera_, tiles, frame_, ground_}; }

  const CameraModel camera_ = flight_camera().camera;
  const LocalFrame frame_{kOrigin};
  const FlatGround ground_;
};

std::unique_ptr<MapMatcher> make_gradient_matcher(const MatcherMap& map) {
  return make_descriptor_matcher(map, std::make_shared<GradientNetwork>());
}

INSTANTIATE_TEST_SUITE_P(Backends, Matcher,
                         testing::Values(Backend{"channels", make_channel_matcher}, Backend{"sift", make_sift_matcher},
                                         Backend{"descriptors", make_gradient_matcher}),
                         [](const auto& tested) { return tested.param.name; });

const Moment& moment() { return short_flight()[1]; }

AnchorPrior prior_near(const CameraPose& truth) {
  AnchorPrior prior;
  prior.search.pose = truth;
  prior.search.pose.position.east_m += 25;
  prior.search.pose.position.north_m -= 18;
  prior.search.pose.agl_m *= 1.01;
  prior.search.pose.attitude.heading_rad += 0.02;
  prior.search.radius_m = 60;
  prior.search.heading_range_rad = 0.06;
  prior.search.scale_range = 0.04;
  prior.heading_sigma_rad = 0.02;
  prior.log_agl_sigma = 0.015;
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 1e-4;
  return prior;
}

// ln ℓ; none without a candidate.
double evidence_of(const AnchorMatch& match, const AnchorPrior& prior) {
  const double side_m = 2 * prior.search.radius_m;
  return match.solved ? log_likelihood_ratio(features_of(match, prior, side_m * side_m)) : -100;
}

void expect_place(const AnchorMatch& match, const AnchorPrior& prior) {
  const CameraPose& truth = moment().truth;
  EXPECT_GT(evidence_of(match, prior), 2)
      << match.search.ratio << " " << (match.solved ? match.solved->inliers : -1) << "/" << match.patches;
  ASSERT_TRUE(match.solved);
  const SolvedPose& solved = *match.solved;
  const Eigen::Vector2d off(solved.pose.position.east_m - truth.position.east_m,
                            solved.pose.position.north_m - truth.position.north_m);
  EXPECT_LT(off.norm(), 3);
  EXPECT_LT(off.dot(solved.covariance.topLeftCorner<2, 2>().inverse() * off), 4 * 13.8) << off.transpose();
  EXPECT_NEAR(solved.pose.attitude.heading_rad, truth.attitude.heading_rad, 0.02);
  EXPECT_NEAR(solved.pose.agl_m, truth.agl_m, 0.03 * truth.agl_m);
  EXPECT_LE(solved.inliers, match.patches);
  EXPECT_GT(match.frame_share, 0.25);
  EXPECT_FALSE(match.rectified.empty());
  EXPECT_EQ(match.rectified.size(), match.matched_map.size());
}

TEST_P(Matcher, FindsAKnownPlace) {
  const AnchorPrior prior = prior_near(moment().truth);
  expect_place(match(landscape_tiles(), moment().image, prior), prior);
}

TEST_P(Matcher, FindsItInTheWholeArea) {
  const AnchorPrior prior = prior_near(moment().truth);
  const auto matcher = GetParam().make(map(landscape_tiles()));
  expect_place(matcher->match_anywhere(moment().image, prior, {-200, -200, 200, 200}), prior);
}

// As crowns of trees and crops do from one year to the next: what is small is another, what is large is still there.
cv::Mat with_other_fine_structure(const cv::Mat& grey) {
  cv::Mat large, small(grey.size(), CV_32FC1);
  grey.convertTo(large, CV_32F);
  cv::GaussianBlur(large, large, cv::Size(), 5);
  Random random(5);
  for (float& value : cv::Mat_<float>(small)) value = static_cast<float>(random.normal(0, 130));
  cv::GaussianBlur(small, small, cv::Size(), 0.8);
  cv::Mat result;
  cv::Mat(large + small).convertTo(result, CV_8U);
  return result;
}

TEST(ChannelMatcher, WhereFinePatchesAgreeOnNothingLargerOnesFindThePose) {
  const CameraModel camera = flight_camera().camera;
  const LocalFrame frame(kOrigin);
  const FlatGround ground;
  const auto matcher = make_channel_matcher({camera, landscape_tiles(), frame, ground});
  const AnchorPrior prior = prior_near(moment().truth);
  const AnchorMatch fine = matcher->match(moment().image, prior);
  const AnchorMatch coarse = matcher->match(with_other_fine_structure(moment().image), prior);
  ASSERT_TRUE(coarse.solved);
  EXPECT_NEAR(coarse.fine_gsd_m, 2 * fine.fine_gsd_m, 0.01 * fine.fine_gsd_m);
  const Eigen::Vector2d off = coarse.solved->pose.position - moment().truth.position;
  EXPECT_LT(off.norm(), 3);
  EXPECT_LT(off.dot(coarse.solved->covariance.topLeftCorner<2, 2>().inverse() * off), 4 * 13.8) << off.transpose();
  EXPECT_EQ(coarse.rectified.size(), coarse.matched_map.size());
  EXPECT_LT(evidence_of(coarse, prior), evidence_of(fine, prior) - 3) << "it says less";
  // Where there is nothing at all, they find nothing that counts.
  const AnchorMatch none =
      matcher->match(with_other_fine_structure(cv::Mat(camera.height, camera.width, CV_8UC1, cv::Scalar(128))), prior);
  EXPECT_LT(evidence_of(none, prior), 0);
}

// Windows side by side: whoever cancels ends the search with the window at hand, and there is no match to judge.
TEST_P(Matcher, GivesUpAnAreaWithoutAResult) {
  constexpr PlaneBox kTwoWindows{-200, -200, 200, 1500};
  AnchorPrior prior = prior_near(moment().truth);
  const auto matcher = GetParam().make(map(landscape_tiles()));
  for (const int at : {1, 2}) {
    CancelAfter after(at);
    prior.cancel = after.cancel();
    EXPECT_THROW(matcher->match_anywhere(moment().image, prior, kTwoWindows), Interrupted) << at;
    EXPECT_EQ(after.asked(), at);
  }
  CancelAfter at_once(1);
  prior.cancel = at_once.cancel();
  EXPECT_THROW(matcher->match_among(moment().image, prior, kTwoWindows, {kTwoWindows, nullptr}), Interrupted);
}

TEST_P(Matcher, IsDeterministic) {
  const AnchorPrior prior = prior_near(moment().truth);
  const auto matcher = GetParam().make(map(landscape_tiles()));
  const AnchorMatch first = matcher->match(moment().image, prior);
  matcher->match(short_flight()[3].image, prior_near(short_flight()[3].truth));
  const AnchorMatch again = matcher->match(moment().image, prior);
  ASSERT_TRUE(first.solved && again.solved);
  EXPECT_EQ(first.solved->pose.position.east_m, again.solved->pose.position.east_m);
  EXPECT_EQ(first.solved->pose.position.north_m, again.solved->pose.position.north_m);
  EXPECT_EQ(first.search.ratio, again.search.ratio);
}

TEST_P(Matcher, AnotherPlaceGivesNoConfidentResult) {
  const AnchorPrior prior = prior_near(moment().truth);
  for (const TileSource* tiles : {&mirrored_tiles(), &rebuilt_tiles()}) {
    EXPECT_LT(evidence_of(match(*tiles, moment().image, prior), prior), 2);
  }
  const Landscape other(78, 160);
  const cv::Mat elsewhere = photograph(other.ground(), camera_, moment().truth);
  EXPECT_LT(evidence_of(match(landscape_tiles(), elsewhere, prior), prior), 2);
}

TEST_P(Matcher, ABlackFrameGivesNoConfidentResult) {
  const AnchorPrior prior = prior_near(moment().truth);
  const cv::Mat black(camera_.height, camera_.width, CV_8UC1, cv::Scalar(0));
  EXPECT_LT(evidence_of(match(landscape_tiles(), black, prior), prior), 2);
}

TEST_P(Matcher, OffTheMapThereIsNoMap) {
  AnchorPrior prior = prior_near(moment().truth);
  prior.search.pose.position = {5000, 5000};
  const AnchorMatch nowhere = match(landscape_tiles(), moment().image, prior);
  EXPECT_FALSE(nowhere.on_map);
  EXPECT_FALSE(nowhere.on_map);
}

// The horizon in the picture: no footprint, no match, no exception.
TEST_P(Matcher, ACameraThatSeesTheHorizonMatchesNothing) {
  AnchorPrior prior = prior_near(moment().truth);
  prior.search.pose.attitude.pitch_rad = 1.2;
  EXPECT_FALSE(match(landscape_tiles(), moment().image, prior).solved);
}

// On the ground before take-off, or by a height that is wrong: the frame shows less than a pixel of the map.
TEST_P(Matcher, AFrameOfLessThanAPixelOfTheMapMatchesNothing) {
  for (const double agl_m : {1.0, 0.1, 0.01}) {
    AnchorPrior prior = prior_near(moment().truth);
    prior.search.pose.agl_m = agl_m;
    EXPECT_LT(evidence_of(match(landscape_tiles(), moment().image, prior), prior), 2) << agl_m;
    const auto matcher = GetParam().make(map(landscape_tiles()));
    EXPECT_LT(evidence_of(matcher->match_anywhere(moment().image, prior, {-100, -100, 100, 100}), prior), 2) << agl_m;
  }
}

// The localizer takes any front end and any matcher.
TEST_P(Matcher, WorksInTheLocalizer) {
  LocalizerConfig configured = config();
  configured.odometry = make_flow_odometry;
  configured.matcher = GetParam().make;
  Localizer localizer(flight_camera(), frame_, &landscape_tiles(), start(), configured);
  for (const Moment& flown : short_flight()) {
    const FrameReport report = localizer.process(flown.image, flown.telemetry);
    expect_sound(report.estimate);
    EXPECT_EQ(report.odometry.tracked, &flown != &short_flight().front());
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted)
        << name_of(report.anchor.verdict) << " " << report.anchor.ratio << " " << report.anchor.inliers << "/"
        << report.anchor.patches;
    EXPECT_LT(off_m(report.estimate, flown), 3.0) << flown.telemetry.frame;
    EXPECT_LT(off_m(report.estimate, flown), 3 * report.estimate.sigma_m);
  }
}

}  // namespace
}  // namespace nadir
