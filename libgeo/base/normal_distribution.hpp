// Share of the standard normal distribution below z, with the same bits on every processor: std::erfc is rounded
// differently by the C libraries of amd64 and arm64, std::exp is not.
//
//   |z| <= 3:  1/2 + φ(z) (z + z³/3 + z⁵/(3·5) + …)          G. Marsaglia, Evaluating the Normal Distribution, J. Stat.
//   Soft. 11 (2004) beyond:    φ(x) / (x + 1/(x + 2/(x + 3/(x + …)))), x = |z|, of the tail
#pragma once

#include <cmath>
#include <numbers>

namespace nadir {

inline double normal_share_below(double z) {
  constexpr int kLevels = 60;  // of the fraction; at 3 the rest is below the last bit
  const double density = std::exp(-z * z / 2) * std::numbers::inv_sqrtpi / std::numbers::sqrt2;
  if (std::abs(z) <= 3) {
    double term = z, sum = z;
    for (int k = 3; std::abs(term) > 1e-18; k += 2) sum += term *= z * z / k;
    return 0.5 + density * sum;
  }
  const double x = std::abs(z);
  // Where the tail, less than density / x, is 0, or is lost beside 1: the same bits without the fraction.
  if (density == 0 || (z > 0 && density < 0x1p-54 * x)) return z < 0 ? 0 : 1;
  double below = x;
  for (int level = kLevels; level > 0; --level) below = x + level / below;
  const double tail = density / below;
  return z < 0 ? tail : 1 - tail;
}

}  // namespace nadir
