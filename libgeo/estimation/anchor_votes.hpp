// Anchors that no healthy prediction can judge judge each other: where several frames, each for itself, would put the
// track to the same place, they are believed. Wrong places scatter over the whole window.
//
// Against a track that an anchor carries without a break more are needed: odometry cannot have leapt, so that either
// the anchor was wrong or the map is, here or there.
#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>
#include <vector>

namespace nadir {

// What it takes.
struct Quorum {
  int voices = 3;       // of the attempts that are asked: two more than that
  double agree_m = 25;  // how near to each other
  // How far the first and the last of them were taken from each other: pictures of the same ground err alike. And they
  // are one voice, however many are taken of it in a second.
  double apart_m = 0;
};

class AnchorVotes {
 public:
  static constexpr int kVoices = 3, kVoicesAgainstAnchors = 6;
  static constexpr double kAgree_m = 25;

  // In a small window places agree by chance: so near that less than one pair in a hundred does.
  static double agree_in_window_m(double radius_m);

  // offset_m: matched position minus the one that odometry carried; at_m: where odometry was (east, north). True:
  // enough agree with this one.
  bool vote(const Eigen::Vector2d& offset_m, const Eigen::Vector2d& at_m, const Quorum& quorum);
  void abstain(const Eigen::Vector2d& at_m);  // an attempt without a plausible match
  // Odometry broke, or an anchor was taken: what was voted before is about another track.
  void forget();

 private:
  struct Attempt {
    Eigen::Vector2d at_m;
    std::optional<Eigen::Vector2d> offset_m;  // none: it abstained
  };
  void remember(const Attempt& attempt);
  std::vector<Attempt> asked(const Quorum& quorum) const;

  std::deque<Attempt> attempts_;
};

}  // namespace nadir
