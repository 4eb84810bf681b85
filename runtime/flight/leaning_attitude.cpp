#include "flight/leaning_attitude.hpp"

#include <algorithm>

namespace nadir {

TelemetryUncertainty fix_aided_attitude(const TelemetryUncertainty& claimed) {
  TelemetryUncertainty honest = claimed;
  honest.heading_rad = std::max(claimed.heading_rad, kLeaningHeading_rad);
  honest.tilt_rad = std::max(claimed.tilt_rad, kLeaningTilt_rad);
  return honest;
}

}  // namespace nadir
