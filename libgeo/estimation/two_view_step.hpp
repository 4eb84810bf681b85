// From points that two pictures share to a step of odometry: what all front ends that compare pictures have in common,
// however they found the points.
#pragma once

#include <opencv2/core/types.hpp>
#include <optional>
#include <vector>

#include "estimation/odometry.hpp"
#include "estimation/two_view_motion.hpp"

namespace nadir {

// Pixels of both working pictures, the same points in the same order. Some may be wrong.
struct SharedPixels {
  std::vector<cv::Point2f> before, now;
};

struct MeasuredStep {
  OdometryStep step;
  TwoViewMotion motion;
};

// The frame with its picture, and its camera, reduced to the size that front ends work at.
OdometryFrame at_working_size(const OdometryFrame& frame);

// A robust homography chooses among the points, then both cameras' attitudes and the motion follow from their rays over
// a plane. Nothing when too few agree. The frames' pictures are not looked at.
std::optional<MeasuredStep> measure_step(const OdometryFrame& before, const OdometryFrame& now,
                                         const SharedPixels& shared);

}  // namespace nadir
