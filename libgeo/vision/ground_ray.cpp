#include "vision/ground_ray.hpp"

#include <algorithm>

namespace nadir {

std::optional<Eigen::Vector3d> first_ground_point(const Eigen::Vector3d& from, const Eigen::Vector3d& direction,
                                                  const GroundSurface& ground, const GroundMarch& march) {
  const auto clearance_m = [&](double along_m) {
    const Eigen::Vector3d at = from + along_m * direction;
    return at.z() - ground.height_m({at.x(), at.y()});
  };
  double before_m = 0, above_m = clearance_m(0);
  if (!(above_m > 0)) return std::nullopt;
  while (before_m < march.range_m) {
    double after_m = before_m + std::clamp(march.share * above_m, march.least_m, march.most_m);
    above_m = clearance_m(after_m);
    if (above_m > 0) {
      before_m = after_m;
      continue;
    }
    for (int i = 0; i < march.bisections; ++i) {
      const double middle_m = 0.5 * (before_m + after_m);
      (clearance_m(middle_m) > 0 ? before_m : after_m) = middle_m;
    }
    return Eigen::Vector3d(from + after_m * direction);
  }
  return std::nullopt;
}

}  // namespace nadir
