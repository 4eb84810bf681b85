#include "counted_share.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

namespace nadir::bench {
namespace {

constexpr double kTail = 0.025;  // of each side of a 95 % interval

// P(X <= count) of a binomial distribution.
double binomial_cdf(int count, int of, double p) {
  if (p <= 0) return 1;
  if (p >= 1) return count >= of ? 1 : 0;
  double sum = 0;
  for (int k = 0; k <= count; ++k) {
    sum += std::exp(std::lgamma(of + 1.0) - std::lgamma(k + 1.0) - std::lgamma(of - k + 1.0) + k * std::log(p) +
                    (of - k) * std::log1p(-p));
  }
  return std::min(sum, 1.0);
}

// Where a falling function of a share passes a value.
double passing(const std::function<double(double)>& falling, double value) {
  double low = 0, high = 1;
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (falling(middle) > value ? low : high) = middle;
  }
  return (low + high) / 2;
}

}  // namespace

double CountedShare::lower() const {
  if (count == 0 || of == 0) return 0;
  return passing([this](double p) { return binomial_cdf(count - 1, of, p); }, 1 - kTail);
}

double CountedShare::upper() const {
  if (count == of) return 1;
  return passing([this](double p) { return binomial_cdf(count, of, p); }, kTail);
}

}  // namespace nadir::bench
