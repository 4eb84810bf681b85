// Anchors that no healthy prediction can judge judge each other: where several frames, each for itself, would put the
// track to the same place, they are believed. Wrong places scatter over the whole window.
#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>

namespace nadir {

class AnchorVotes {
 public:
  // The last so many attempts are asked, and so many of them must agree within this distance.
  static constexpr std::size_t kAsked = 5, kNeeded = 3;
  static constexpr double kAgree_m = 25;

  // offset_m: matched position minus the one that odometry carried (east, north). True: enough agree with this one.
  bool vote(const Eigen::Vector2d& offset_m);
  void abstain();  // an attempt without a plausible match
  // Odometry broke, or an anchor was taken: what was voted before is about another track.
  void forget();

 private:
  void remember(const std::optional<Eigen::Vector2d>& offset_m);

  std::deque<std::optional<Eigen::Vector2d>> offsets_m_;
};

}  // namespace nadir
