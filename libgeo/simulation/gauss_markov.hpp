// A first-order Gauss-Markov process, exact for any step.
#pragma once

#include <cmath>

#include "base/random.hpp"

namespace nadir {

class GaussMarkovProcess {
 public:
  GaussMarkovProcess(Random& random, double sigma, double correlation_s)
      : sigma_(sigma), correlation_s_(correlation_s), value_(random.normal(0, sigma)) {}

  double step(double seconds, Random& random) {
    const double keep = std::exp(-seconds / correlation_s_);
    value_ = keep * value_ + sigma_ * std::sqrt(1 - keep * keep) * random.normal();
    return value_;
  }
  double value() const { return value_; }

 private:
  double sigma_, correlation_s_, value_;
};

}  // namespace nadir
