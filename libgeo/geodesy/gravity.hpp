// Standard gravity, which instruments count in.
#pragma once

namespace nadir {

inline constexpr double kStandardGravity_mps2 = 9.80665;  // CGPM 1901

}  // namespace nadir
