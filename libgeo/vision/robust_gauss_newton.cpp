#include "vision/robust_gauss_newton.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nadir {

double effective_sample_size(const std::vector<Eigen::Vector2d>& positions,
                             const std::vector<Eigen::Vector2d>& residuals) {
  const std::size_t n = positions.size();
  if (n < 2) return static_cast<double>(n);
  Eigen::Vector2d low = positions.front(), high = positions.front();
  for (const auto& position : positions) {
    low = low.cwiseMin(position);
    high = high.cwiseMax(position);
  }
  const double ring = kCorrelationReach * (high - low).norm() / static_cast<double>(kCorrelationRings);
  if (!(ring > 0)) return 1;
  const std::size_t stride = (n + kCorrelationSamples - 1) / kCorrelationSamples;
  std::array<double, kCorrelationRings> products{}, pairs{};
  double squares = 0, used = 0;
  for (std::size_t i = 0; i < n; i += stride) {
    squares += residuals[i].squaredNorm();
    ++used;
    for (std::size_t j = i + stride; j < n; j += stride) {
      const auto k = static_cast<std::size_t>((positions[i] - positions[j]).norm() / ring);
      if (k >= kCorrelationRings) continue;
      products[k] += residuals[i].dot(residuals[j]);
      ++pairs[k];
    }
  }
  if (!(squares > 0)) return static_cast<double>(n);
  const double variance = squares / used;
  // Sum of the correlations of one measurement with all others; beyond the first ring without correlation it is noise.
  double others = 0;
  for (std::size_t k = 0; k < kCorrelationRings; ++k) {
    if (pairs[k] == 0) continue;
    const double correlation = products[k] / pairs[k] / variance;
    if (correlation <= 0) break;
    others += correlation * 2 * pairs[k] / used;
  }
  const double scaled = others * static_cast<double>(n) / used;
  return std::clamp(static_cast<double>(n) / (1 + scaled), 1.0, static_cast<double>(n));
}

}  // namespace nadir
