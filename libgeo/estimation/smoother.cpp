#include "estimation/smoother.hpp"

#include <Eigen/LU>

namespace nadir {

std::vector<SmoothedPoint> smooth(const std::vector<TrackPoint>& track) {
  std::vector<SmoothedPoint> smoothed(track.size());
  for (std::size_t i = track.size(); i-- > 0;) {
    smoothed[i] = {track[i].position_m, track[i].covariance_m2};
    if (i + 1 == track.size()) continue;
    const TrackPoint& next = track[i + 1];
    const Eigen::Matrix2d gain = track[i].covariance_m2 * next.predicted_m2.inverse();
    smoothed[i].position_m += gain * (smoothed[i + 1].position_m - next.predicted_m);
    smoothed[i].covariance_m2 += gain * (smoothed[i + 1].covariance_m2 - next.predicted_m2) * gain.transpose();
  }
  return smoothed;
}

}  // namespace nadir
