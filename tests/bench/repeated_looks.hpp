// How looks in a row depend on each other: two frames that share ground, matched in the same kind of window, and
// whether a chance peak of the first is there again in the second.
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "look.hpp"
#include "look_rates.hpp"

namespace nadir::bench {

struct RepeatedLook {
  std::uint64_t index = 0;
  std::string ground, window, picture;
  double new_ground = 1;  // LooksInARow's
  struct One {
    bool candidate = false, right = false;
    double log_likelihood_ratio = 0;
    Eigen::Vector2d off_m = Eigen::Vector2d::Zero();  // of the position, from the truth
    double sigma_m = 0;                               // one axis, as the belief takes it
  } first, second;

  bool chance_first() const { return first.candidate && !first.right; }
  // The second candidate is where the first one was, as far as the belief can tell.
  bool seen_again() const;
};

using RepeatedLooks = std::map<std::uint64_t, RepeatedLook>;

std::string repeated_header(std::uint64_t base_seed, const LookPlan& plan, const Grounds& grounds);
std::string line(const RepeatedLook& look);
RepeatedLook repeated_look_of(const std::string& line);                // throws Error for anything else
RepeatedLooks read_repeated_looks(const std::filesystem::path& path);  // throws Error for another file
RepeatedLook take_repeated_look(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed,
                                std::uint64_t index);

// Counted rates by the share of new ground. Strong chance peaks, with a weight of evidence above zero, are few: they
// are counted together where half of the ground or more is shared, and where less is.
class RepeatRates {
 public:
  static constexpr std::array kNewGround = {0.1, 0.25, 0.5, 0.75, 1.0, 1.5};  // middles of the bins
  static constexpr double kMostlyShared = 0.6;
  struct Bin {
    CountedShare weak_again;  // chance peaks that were seen again
    CountedShare same_side;   // of true places: the errors of both are less than 90° apart
  };

  explicit RepeatRates(const RepeatedLooks& looks);
  std::string table() const;

  // Upper bounds, 95 %: that a chance peak is seen again; that the error of a true place is that of the last one (else
  // it lies on the same side half of the time).
  double again(double new_ground, bool strong) const;
  double error_stays(double new_ground) const { return stays_[bin_of(new_ground)]; }
  // Of peaks that were seen again: the second weight of evidence less the first, and how far apart they were (on a
  // ground of unit 1, look_grounds.hpp).
  struct Change {
    double nats = 0, moved_m = 0;
  };
  const std::vector<Change>& changes(bool strong) const { return changes_[strong ? 1 : 0]; }

  const Bin& bin(double new_ground) const { return bins_[bin_of(new_ground)]; }
  const CountedShare& strong_again(double new_ground) const { return strong_again_[strong_bin_of(new_ground)]; }

 private:
  static std::size_t bin_of(double new_ground);
  static std::size_t strong_bin_of(double new_ground) { return new_ground <= kMostlyShared ? 0 : 1; }

  std::array<Bin, kNewGround.size()> bins_;
  std::array<CountedShare, 2> strong_again_;
  std::array<std::vector<Change>, 2> changes_;
  std::array<double, kNewGround.size()> weak_upper_{}, stays_{};
  std::array<double, 2> strong_upper_{};
};

}  // namespace nadir::bench
