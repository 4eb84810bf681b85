// Two frames that do not follow each other, and may show the same ground: the same features, matches and motion as
// between consecutive frames (make_feature_odometry(), whose parts these are).
//
//   const OdometryFeatures before = odometry_features(one), now = odometry_features(other);
//   const auto motion = measure_motion(before.frame, now.frame, similar_pixels(before, now));
#pragma once

#include "estimation/visual_odometry.hpp"
#include "vision/sift_features.hpp"

namespace nadir {

// What is kept of a frame: a third of a megabyte. The front end keeps the image as well, half as much again.
struct OdometryFeatures {
  OdometryFrame frame;    // at working size; of odometry_features() without its image
  SiftFeatures features;  // pixels of that size
};

OdometryFeatures odometry_features(const OdometryFrame& frame);

// Features that are alike, by the ratio test; many of them wrongly.
PixelPairs similar_pixels(const OdometryFeatures& before, const OdometryFeatures& now);

}  // namespace nadir
