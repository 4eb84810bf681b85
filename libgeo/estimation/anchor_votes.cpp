#include "estimation/anchor_votes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nadir {
namespace {

constexpr int kSpare = 2;  // attempts that may fail in between
// Attempts. From 1000 m above ground a picture shows 2 km, and six voices must lie along most of that: at ten attempts
// a second, two metres apart, this reaches as far.
constexpr std::size_t kRemembered = 1024;
constexpr double kByChance = 0.01;

}  // namespace

double AnchorVotes::agree_in_window_m(double radius_m) {
  return std::min(kAgree_m, 2 * radius_m * std::sqrt(kByChance / std::numbers::pi));
}

bool AnchorVotes::vote(const Eigen::Vector2d& offset_m, const Eigen::Vector2d& at_m, const Quorum& quorum) {
  remember({at_m, offset_m});
  int agreeing = 0;
  double apart_m = 0;
  for (const Attempt& attempt : asked(quorum)) {
    if (!attempt.offset_m || (*attempt.offset_m - offset_m).norm() > quorum.agree_m) continue;
    ++agreeing;
    apart_m = std::max(apart_m, (attempt.at_m - at_m).norm());
  }
  return agreeing >= quorum.voices && apart_m >= quorum.apart_m;
}

// The newest of each stretch of the way: so short a stretch that all who are needed fit between the first and the last.
std::vector<AnchorVotes::Attempt> AnchorVotes::asked(const Quorum& quorum) const {
  const double stretch_m = quorum.apart_m / (quorum.voices + 1);
  std::vector<Attempt> asked;
  for (auto attempt = attempts_.rbegin(); attempt != attempts_.rend(); ++attempt) {
    if (!asked.empty() && (attempt->at_m - asked.back().at_m).norm() < stretch_m) continue;
    asked.push_back(*attempt);
    if (std::ssize(asked) == quorum.voices + kSpare) break;
  }
  return asked;
}

void AnchorVotes::abstain(const Eigen::Vector2d& at_m) { remember({at_m, std::nullopt}); }
void AnchorVotes::forget() { attempts_.clear(); }

void AnchorVotes::remember(const Attempt& attempt) {
  attempts_.push_back(attempt);
  if (attempts_.size() > kRemembered) attempts_.pop_front();
}

}  // namespace nadir
