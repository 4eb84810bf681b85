#include "estimation/anchor_votes.hpp"

#include <algorithm>

namespace nadir {

namespace {

constexpr int kSpare = 2;  // attempts that may fail in between

}  // namespace

bool AnchorVotes::vote(const Eigen::Vector2d& offset_m, int needed) {
  remember(offset_m);
  const auto asked = std::min<std::ptrdiff_t>(needed + kSpare, std::ssize(offsets_m_));
  const auto agreeing = std::count_if(offsets_m_.end() - asked, offsets_m_.end(), [&](const auto& other) {
    return other && (*other - offset_m).norm() <= kAgree_m;
  });
  return agreeing >= needed;
}

void AnchorVotes::abstain() { remember(std::nullopt); }
void AnchorVotes::forget() { offsets_m_.clear(); }

void AnchorVotes::remember(const std::optional<Eigen::Vector2d>& offset_m) {
  offsets_m_.push_back(offset_m);
  if (offsets_m_.size() > kNeededAgainstAnchors + kSpare) offsets_m_.pop_front();
}

}  // namespace nadir
