#include "base/normal_distribution.hpp"

#include <boost/math/special_functions/erf.hpp>
#include <cmath>
#include <numbers>

namespace nadir {

double normal_share_below(double z) {
  constexpr double kNothingAbove = 8.3, kNothingBelow = -38.6;  // the tail is lost beside 1; is no number above 0
  if (std::isnan(z)) return z;
  if (z >= kNothingAbove) return 1;
  if (z <= kNothingBelow) return 0;
  // Rational functions in double alone: by default long double is used, which differs between processors.
  using InDouble = boost::math::policies::policy<boost::math::policies::promote_double<false>>;
  return boost::math::erfc(-z * (std::numbers::sqrt2 / 2), InDouble()) / 2;
}

}  // namespace nadir
