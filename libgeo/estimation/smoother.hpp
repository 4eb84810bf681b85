// The track after the flight: the filter's estimates improved by the anchors that came later (Rauch-Tung-Striebel).
#pragma once

#include <Eigen/Core>
#include <vector>

namespace nadir {

// One frame as the filter left it. Between two frames the motion was `moved_m` with covariance `motion_m2`.
struct TrackPoint {
  Eigen::Vector2d position_m = Eigen::Vector2d::Zero();  // after the frame's own anchor, if it had one
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Identity();
  Eigen::Vector2d predicted_m = Eigen::Vector2d::Zero();  // before it
  Eigen::Matrix2d predicted_m2 = Eigen::Matrix2d::Identity();
};

struct SmoothedPoint {
  Eigen::Vector2d position_m;
  Eigen::Matrix2d covariance_m2;
};

std::vector<SmoothedPoint> smooth(const std::vector<TrackPoint>& track);

}  // namespace nadir
