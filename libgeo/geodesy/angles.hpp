// Angles: radians inside, degrees (suffix _deg) in files and messages.
#pragma once

#include <cmath>
#include <numbers>

namespace nadir {

inline constexpr double kPi = std::numbers::pi;

constexpr double radians(double degrees) { return degrees * (kPi / 180.0); }
constexpr double degrees(double radians) { return radians * (180.0 / kPi); }

// Into (-pi, pi].
inline double wrap_pi(double angle_rad) {
  const double wrapped = std::remainder(angle_rad, 2.0 * kPi);
  return wrapped <= -kPi ? kPi : wrapped;
}

}  // namespace nadir
