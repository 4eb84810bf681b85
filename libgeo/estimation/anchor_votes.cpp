#include "estimation/anchor_votes.hpp"

#include <algorithm>

namespace nadir {

bool AnchorVotes::vote(const Eigen::Vector2d& offset_m) {
  remember(offset_m);
  const auto agreeing = std::count_if(offsets_m_.begin(), offsets_m_.end(), [&](const auto& other) {
    return other && (*other - offset_m).norm() <= kAgree_m;
  });
  return agreeing >= static_cast<std::ptrdiff_t>(kNeeded);
}

void AnchorVotes::abstain() { remember(std::nullopt); }
void AnchorVotes::forget() { offsets_m_.clear(); }

void AnchorVotes::remember(const std::optional<Eigen::Vector2d>& offset_m) {
  offsets_m_.push_back(offset_m);
  if (offsets_m_.size() > kAsked) offsets_m_.pop_front();
}

}  // namespace nadir
