#include "vision/independent_count.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nadir {
namespace {

constexpr std::size_t kRings = 8;
constexpr double kReach = 0.4;            // of the crowd's extent: farther apart nothing is learnt about correlation
constexpr std::size_t kMostPlaces = 300;  // of which the correlation is taken; more tell no more

}  // namespace

double effective_sample_size(const std::vector<Eigen::Vector2d>& places, const std::vector<Eigen::Vector2d>& residuals) {
  const std::size_t n = places.size();
  if (n < 2) return static_cast<double>(n);
  Eigen::Vector2d low = places.front(), high = places.front();
  for (const auto& place : places) {
    low = low.cwiseMin(place);
    high = high.cwiseMax(place);
  }
  const double ring = kReach * (high - low).norm() / static_cast<double>(kRings);
  if (!(ring > 0)) return 1;
  const std::size_t stride = (n + kMostPlaces - 1) / kMostPlaces;
  std::array<double, kRings> products{}, pairs{};
  double squares = 0, used = 0;
  for (std::size_t i = 0; i < n; i += stride) {
    squares += residuals[i].squaredNorm();
    ++used;
    for (std::size_t j = i + stride; j < n; j += stride) {
      const auto k = static_cast<std::size_t>((places[i] - places[j]).norm() / ring);
      if (k >= kRings) continue;
      products[k] += residuals[i].dot(residuals[j]);
      ++pairs[k];
    }
  }
  if (!(squares > 0)) return static_cast<double>(n);
  const double variance = squares / used;
  // Sum of the correlations of one measurement with all others; beyond the first ring without any it is noise.
  double others = 0;
  for (std::size_t k = 0; k < kRings; ++k) {
    if (pairs[k] == 0) continue;
    const double correlation = products[k] / pairs[k] / variance;
    if (correlation <= 0) break;
    others += correlation * 2 * pairs[k] / used;
  }
  const double scaled = others * static_cast<double>(n) / used;
  return std::clamp(static_cast<double>(n) / (1 + scaled), 1.0, static_cast<double>(n));
}

}  // namespace nadir
