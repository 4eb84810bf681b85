// What the map has said against the start, while nothing is anchored yet.
//
// A start that is known to 8 m and a map that puts the first frame 50 m away contradict each other, and one of them is
// wrong. Flying on does not settle it: the prediction grows vaguer, so that the same contradiction, carried along by
// odometry, would look smaller from frame to frame until it passed the gate. It is worth what it was worth at its
// worst.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace nadir {

class StartContradictions {
 public:
  static constexpr double kSame_m = 25;  // matches that lie so near say the same, …
  static constexpr double kDrifts = 3;   // … and by so many times what the position has become vaguer since

  // The chi-square that a match must answer for: its own, or the largest of those that said the same.
  // offset_m: the matched position minus the predicted one (east, north). sigma_m: of the prediction, one axis.
  double weighed(const Eigen::Vector2d& offset_m, double chi2, double sigma_m) const;

  // A match that was refused, or awaits votes, because it contradicts.
  void remember(const Eigen::Vector2d& offset_m, double chi2, double sigma_m);

  void forget() { said_.clear(); }  // a first anchor was found, or somebody who knows better has spoken

 private:
  static constexpr std::size_t kMostPlaces = 8;
  struct Said {
    Eigen::Vector2d offset_m;
    double chi2, sigma_m;
    bool same(const Eigen::Vector2d& other_m, double now_sigma_m) const;
  };
  std::vector<Said> said_;  // a few places: chance matches lie elsewhere each time
};

}  // namespace nadir
