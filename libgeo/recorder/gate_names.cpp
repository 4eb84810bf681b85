#include "recorder/gate_names.hpp"

#include <array>
#include <cmath>
#include <limits>

namespace nadir {
namespace {

struct Name {
  std::string_view name;
  double GateLimits::*value;
};

constexpr std::array<Name, 23> kNames{{
    {"clear_ratio", &GateLimits::clear_ratio},
    {"clear_inlier_share", &GateLimits::clear_inlier_share},
    {"alone_ratio", &GateLimits::alone_ratio},
    {"alone_inlier_share", &GateLimits::alone_inlier_share},
    {"vote_ratio", &GateLimits::vote_ratio},
    {"vote_inlier_share", &GateLimits::vote_inlier_share},
    {"most_inlier_share", &GateLimits::most_inlier_share},
    {"sure_inlier_share", &GateLimits::sure_inlier_share},
    {"expected_chi2", &GateLimits::expected_chi2},
    {"max_chance_residual_px", &GateLimits::max_chance_residual_px},
    {"open_tilt_rad", &GateLimits::open_tilt_rad},
    {"telling_window_m", &GateLimits::telling_window_m},
    {"sharp_sigma_m", &GateLimits::sharp_sigma_m},
    {"min_score", &GateLimits::min_score},
    {"min_sharp_score", &GateLimits::min_sharp_score},
    {"min_frame_share", &GateLimits::min_frame_share},
    {"max_residual_px", &GateLimits::max_residual_px},
    {"max_tilt_sigmas", &GateLimits::max_tilt_sigmas},
    {"chi2_999", &GateLimits::chi2_999},
    {"chi2_99", &GateLimits::chi2_99},
    {"healthy_sigma_m", &GateLimits::healthy_sigma_m},
    {"lost_ratio", &GateLimits::lost_ratio},
    {"lost_inlier_share", &GateLimits::lost_inlier_share},
}};
constexpr std::string_view kMinInliers = "min_inliers";

// A threshold that is added to the gates must be added here as well.
static_assert(sizeof(GateLimits) == kNames.size() * sizeof(double) + sizeof(double));

}  // namespace

std::vector<std::pair<std::string, double>> named_gates(const GateLimits& gates) {
  std::vector<std::pair<std::string, double>> named;
  for (const Name& gate : kNames) named.emplace_back(gate.name, gates.*gate.value);
  named.emplace_back(kMinInliers, gates.min_inliers);
  return named;
}

void set_gate(GateLimits& gates, std::string_view name, double value) {
  for (const Name& gate : kNames) {
    if (gate.name == name) gates.*gate.value = value;
  }
  const bool fits = std::abs(value) <= std::numeric_limits<int>::max();  // not so for NaN
  if (name == kMinInliers && fits) gates.min_inliers = static_cast<int>(value);
}

}  // namespace nadir
