#include "estimation/anchor_votes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nadir {
namespace {

constexpr int kSpare = 2;  // attempts that may fail in between
constexpr double kByChance = 0.01;

}  // namespace

double AnchorVotes::agree_in_window_m(double radius_m) {
  return std::min(kAgree_m, 2 * radius_m * std::sqrt(kByChance / std::numbers::pi));
}

bool AnchorVotes::vote(const Eigen::Vector2d& offset_m, const Eigen::Vector2d& at_m, const Quorum& quorum) {
  remember(Voice{offset_m, at_m});
  const auto asked = std::min<std::ptrdiff_t>(quorum.voices + kSpare, std::ssize(voices_));
  int agreeing = 0;
  double apart_m = 0;
  for (auto voice = voices_.end() - asked; voice != voices_.end(); ++voice) {
    if (!*voice || ((*voice)->offset_m - offset_m).norm() > quorum.agree_m) continue;
    ++agreeing;
    apart_m = std::max(apart_m, ((*voice)->at_m - at_m).norm());
  }
  return agreeing >= quorum.voices && apart_m >= quorum.apart_m;
}

void AnchorVotes::abstain() { remember(std::nullopt); }
void AnchorVotes::forget() { voices_.clear(); }

void AnchorVotes::remember(const std::optional<Voice>& voice) {
  voices_.push_back(voice);
  if (voices_.size() > kVoicesAgainstAnchors + kSpare) voices_.pop_front();
}

}  // namespace nadir
