#include "estimation/start_contradictions.hpp"

#include <algorithm>

namespace nadir {

bool StartContradictions::Said::same(const Eigen::Vector2d& other_m, double now_sigma_m) const {
  return (other_m - offset_m).norm() <= kSame_m + kDrifts * std::max(0.0, now_sigma_m - sigma_m);
}

double StartContradictions::weighed(const Eigen::Vector2d& offset_m, double chi2, double sigma_m) const {
  for (const Said& said : said_) {
    if (said.same(offset_m, sigma_m)) chi2 = std::max(chi2, said.chi2);
  }
  return chi2;
}

void StartContradictions::remember(const Eigen::Vector2d& offset_m, double chi2, double sigma_m) {
  const Said now{offset_m, weighed(offset_m, chi2, sigma_m), sigma_m};
  std::erase_if(said_, [&](const Said& said) { return said.same(offset_m, sigma_m); });
  if (said_.size() == kMostPlaces) said_.erase(said_.begin());  // the one heard of least lately
  said_.push_back(now);
}

}  // namespace nadir
