// Many drawn flights together: does the flight filter err as much as it says?
#pragma once

#include "estimation/drawn_flight.hpp"

namespace nadir::test {

// Normalised errors with two degrees of freedom: their mean is 2 where covariances are right, less where cautious.
struct Tally {
  double sum = 0;
  int count = 0, in_50 = 0, in_95 = 0;

  void add(double chi2);
  double mean() const { return sum / count; }
  double share_50() const { return static_cast<double>(in_50) / count; }
  double share_95() const { return static_cast<double>(in_95) / count; }
};

struct Consistency {
  Tally online, blind, smoothed, anchors;             // NEES of all frames, of blind ones, after the flight; NIS
  double online_error_m2 = 0, smoothed_error_m2 = 0;  // mean squares
  int frames_within = 0;  // indices of frames whose mean over the flights lies in the 95 % interval of that mean
};

Consistency measure_consistency(int flights, std::uint64_t seed, const DrawnOptions& options);

// 95 % of means of so many independent values with two degrees of freedom lie between (Wilson and Hilferty).
std::pair<double, double> chi2_mean_interval(int count);

}  // namespace nadir::test
