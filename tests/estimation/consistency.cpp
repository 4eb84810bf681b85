#include "estimation/consistency.hpp"

#include <cmath>

namespace nadir::test {

void Tally::add(double chi2) {
  sum += chi2;
  ++count;
  in_50 += chi2 <= 1.386;
  in_95 += chi2 <= 5.991;
}

std::pair<double, double> chi2_mean_interval(int count) {
  const double freedom = 2.0 * count, spread = 2 / (9 * freedom);
  const auto at = [&](double z) { return 2 * std::pow(1 - spread + z * std::sqrt(spread), 3); };
  return {at(-1.95996), at(1.95996)};
}

Consistency measure_consistency(int flights, std::uint64_t seed, const DrawnOptions& options) {
  Consistency all;
  std::vector<double> of_index(static_cast<std::size_t>(options.frames), 0);
  for (int i = 0; i < flights; ++i) {
    const DrawnFlight flight = draw_flight(Random(seed).fork("flight", static_cast<std::uint64_t>(i)), options);
    const auto smoothed = smooth_flight(flight.fresh, flight.steps).frames;
    for (std::size_t k = 0; k < flight.frames.size(); ++k) {
      const DrawnFrame& frame = flight.frames[k];
      all.online.add(frame.nees);
      if (frame.blind) all.blind.add(frame.nees);
      if (frame.anchor_chi2) all.anchors.add(*frame.anchor_chi2);
      all.smoothed.add(normalised_error(smoothed[k].position.vector() - frame.truth_m, smoothed[k].covariance_m2));
      all.online_error_m2 += (frame.online_m - frame.truth_m).squaredNorm();
      all.smoothed_error_m2 += (smoothed[k].position.vector() - frame.truth_m).squaredNorm();
      of_index[k] += frame.nees / flights;
    }
  }
  all.online_error_m2 /= all.online.count;
  all.smoothed_error_m2 /= all.online.count;
  const auto [low, high] = chi2_mean_interval(flights);
  for (const double mean : of_index) all.frames_within += mean >= low && mean <= high;
  return all;
}

}  // namespace nadir::test
