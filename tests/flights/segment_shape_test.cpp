// The similarity of a segment by its looks: whether its covariances hold where the looks are as good as stated, and
// where they are better.
#include "flights/segment_shape.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "base/random.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr double kLook_m = 1.5, kStep_m = 0.2;  // stated, one axis
constexpr double kChi2Of2_95 = 5.991;

struct Consistency {
  double nees = 0;    // of one degree of freedom: 1 where covariances hold
  double within = 0;  // share of poses inside of their 95 % ellipse
};

// Segments of eight frames, 25 m apart, whose first so many are looked at. true_over_stated: of all sigmas.
Consistency consistency_of(double true_over_stated, std::size_t looks, bool scaled) {
  constexpr int kSegments = 300;
  Consistency sum;
  int poses = 0;
  for (int segment = 0; segment < kSegments; ++segment) {
    Random random(static_cast<std::uint64_t>(segment) + 1);
    const auto drawn_m = [&](double sigma_m) {
      const double east_m = random.normal(0, true_over_stated * sigma_m);
      return Eigen::Vector2d(east_m, random.normal(0, true_over_stated * sigma_m));
    };
    SegmentShape shape;
    shape.turn_sigma_rad = radians(1);
    shape.log_scale_sigma = 0.015;
    std::vector<PlanePoint> truth;
    for (std::size_t i = 0; i < 8; ++i) {
      ShapeFrame& frame = shape.frames.emplace_back();
      frame.frame = i;
      frame.agl_m = 100;
      frame.offset_m = {0, 25.0 * static_cast<double>(i)};
      frame.step_covariance_m2 = kStep_m * kStep_m * Eigen::Matrix2d::Identity();
      truth.push_back(i == 0 ? PlanePoint{} : truth.back() + Eigen::Vector2d(0, 25) + drawn_m(kStep_m));
    }
    SegmentSimilarity::Prior prior;
    prior.position = truth.front() + drawn_m(15);
    prior.position_sigma_m = 15;
    prior.turn_sigma_rad = shape.turn_sigma_rad;
    prior.log_scale_sigma = shape.log_scale_sigma;
    SegmentSimilarity similarity(shape, prior);
    for (std::size_t i = 0; i < looks; ++i) {
      similarity.add({.index = i,
                      .position = truth[i] + drawn_m(kLook_m),
                      .covariance_m2 = kLook_m * kLook_m * Eigen::Matrix2d::Identity(),
                      .heading_rad = random.normal(0, radians(1.5)),
                      .heading_sigma_rad = radians(1.5)});
    }
    if (scaled) similarity.scale_looks_by_scatter();
    for (std::size_t i = 0; i < looks; ++i) {
      const SegmentSimilarity::Pose pose = similarity.pose(i);
      const Eigen::Vector2d off_m = pose.position - truth[i];
      const double squared = off_m.dot(pose.covariance_m2.inverse() * off_m);
      sum.nees += squared / 2;
      sum.within += squared <= kChi2Of2_95 ? 1 : 0;
      ++poses;
    }
  }
  return {sum.nees / poses, sum.within / poses};
}

TEST(SegmentSimilarity, HoldsWhereLooksAreAsGoodAsStated) {
  for (const std::size_t looks : {2U, 4U, 8U}) {
    for (const bool scaled : {false, true}) {
      const Consistency found = consistency_of(1, looks, scaled);
      EXPECT_GT(found.within, 0.93) << looks << scaled;
      EXPECT_GT(found.nees, scaled && looks == 2 ? 0.5 : 0.75) << looks << scaled;  // of two, nothing is learnt
      EXPECT_LT(found.nees, 1.25) << looks << scaled;
    }
  }
}

TEST(SegmentSimilarity, LearnsFromItsLooksThatTheyAreBetterThanStated) {
  EXPECT_LT(consistency_of(0.2, 8, false).nees, 0.1);
  const Consistency found = consistency_of(0.2, 8, true);
  EXPECT_GT(found.nees, 0.2);
  EXPECT_LT(found.nees, 1.1);
  EXPECT_GT(found.within, 0.95);
  EXPECT_LT(consistency_of(0.2, 2, true).nees, 0.2) << "two looks that agree say little";
}

TEST(SegmentSimilarity, LearnsFromItsLooksThatTheyAreWorseThanStated) {
  EXPECT_GT(consistency_of(2, 8, false).nees, 3);
  const Consistency found = consistency_of(2, 8, true);
  EXPECT_LT(found.nees, 1.8);
  EXPECT_GT(found.within, 0.85);
}

TEST(SegmentSimilarity, NeedsNoLook) {
  SegmentShape shape;
  shape.frames.resize(2);
  SegmentSimilarity::Prior prior;
  prior.position_sigma_m = 15;
  SegmentSimilarity similarity(shape, prior);
  similarity.scale_looks_by_scatter();
  EXPECT_NEAR(similarity.pose(0).covariance_m2(0, 0), 225, 1e-9);
}

}  // namespace
}  // namespace nadir
