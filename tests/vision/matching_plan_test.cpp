// Which ground a search reads: all that the frame may show, and not much more.
#include "vision/matching_plan.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "geodesy/angles.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

MatchingPlan plan_for(const AnchorPrior& prior) {
  const auto plan = matching_plan(test::small_camera(), {17, 19}, LocalFrame({11.2, 48.1}), prior.search);
  EXPECT_TRUE(plan);
  return plan.value();
}

AnchorPrior prior_at(PlanePoint at, double roll_rad) {
  AnchorPrior prior;
  prior.search = {{at, 200, {radians(75), radians(3), roll_rad}}, 60, radians(12), 0.06};
  return prior;
}

bool holds(const PlaneBox& box, const PlaneBox& inner) {
  return box.west_m <= inner.west_m && box.east_m >= inner.east_m && box.south_m <= inner.south_m &&
         box.north_m >= inner.north_m;
}

double area_m2(const PlaneBox& box) { return (box.east_m - box.west_m) * (box.north_m - box.south_m); }

TEST(SearchedGround, ContainsEveryFootprintOfTheSearch) {
  for (const double roll_deg : {0.0, 25.0, -25.0}) {
    const AnchorPrior prior = prior_at({300, -200}, radians(roll_deg));
    const PlaneBox ground = searched_ground(test::small_camera(), prior, plan_for(prior));
    for (const double turn : {-1.0, -0.4, 0.0, 0.7, 1.0}) {
      for (const double scale : {-1.0, 1.0}) {
        for (const double side : {-1.0, 1.0}) {
          CameraPose pose = prior.search.pose;
          pose.attitude.heading_rad += turn * prior.search.heading_range_rad;
          pose.agl_m *= 1 + scale * prior.search.scale_range;
          pose.position.east_m += side * prior.search.radius_m;
          pose.position.north_m -= side * prior.search.radius_m;
          const auto footprint = footprint_of(test::small_camera(), pose);
          ASSERT_TRUE(footprint);
          EXPECT_TRUE(holds(ground, *footprint)) << roll_deg << ' ' << turn << ' ' << scale << ' ' << side;
        }
      }
    }
  }
}

// A banked camera looks to one side: the other need not be read.
TEST(SearchedGround, IsLessThanTheSquareAroundTheCamera) {
  const AnchorPrior prior = prior_at({0, 0}, radians(25));
  const MatchingPlan plan = plan_for(prior);
  const PlaneBox ground = searched_ground(test::small_camera(), prior, plan);
  const double half_m = prior.search.radius_m + plan.reach_m;
  EXPECT_LT(area_m2(ground), 0.7 * 4 * half_m * half_m);
}

TEST(SearchedGround, GrowsWithAnUncertainTilt) {
  AnchorPrior prior = prior_at({0, 0}, 0);
  const PlaneBox known = searched_ground(test::small_camera(), prior, plan_for(prior));
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 0.3 * 0.3;
  const PlaneBox open = searched_ground(test::small_camera(), prior, plan_for(prior));
  EXPECT_TRUE(holds(open, known));
  EXPECT_GT(open.east_m - known.east_m, 0.3 * 200 / 2);
}

}  // namespace
}  // namespace nadir
