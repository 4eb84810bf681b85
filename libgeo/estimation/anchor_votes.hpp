// Anchors that no healthy prediction can judge judge each other: where several frames, each for itself, would put the
// track to the same place, they are believed. Wrong places scatter over the whole window.
//
// Against a track that an anchor carries without a break more are needed: odometry cannot have leapt, so that either
// the anchor was wrong or the map is, here or there.
#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>

namespace nadir {

class AnchorVotes {
 public:
  // So many must agree within this distance, of the attempts that are asked: two more than are needed.
  static constexpr int kNeeded = 3, kNeededAgainstAnchors = 6;
  static constexpr double kAgree_m = 25;

  // offset_m: matched position minus the one that odometry carried (east, north). True: enough agree with this one.
  bool vote(const Eigen::Vector2d& offset_m, int needed = kNeeded);
  void abstain();  // an attempt without a plausible match
  // Odometry broke, or an anchor was taken: what was voted before is about another track.
  void forget();

 private:
  void remember(const std::optional<Eigen::Vector2d>& offset_m);

  std::deque<std::optional<Eigen::Vector2d>> offsets_m_;
};

}  // namespace nadir
