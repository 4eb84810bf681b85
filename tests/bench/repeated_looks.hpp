// How looks in a row depend on each other: two frames that share ground, matched in the same kind of window, and
// whether a chance peak of the first is there again in the second.
//
// Counted are pairs whose first candidate is a chance peak. d² = |z2 - z1|² / (σ1² + σ2²) says how far apart both are.
// A peak that is seen again lies within a disc, d² <= 6 (95 % of χ² with two degrees of freedom). So do candidates that
// have nothing to do with the first: they lie anywhere in the window, as densely in the disc as in the ring around it,
// 6 < d² <= 13.8. Hence
//
//   P(again) <= upper bound of (pairs in the disc) - 6 / 7.8 lower bound of (pairs in the ring)
//
// The second weight of evidence follows the first one as a line with slope, the rest is drawn from the measured rests:
//   ℓ2 = intercept + slope ℓ1 + rest
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "counted_share.hpp"
#include "look.hpp"

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
    bool chance() const { return candidate && !right; }
  } first, second;
};

using RepeatedLooks = std::map<std::uint64_t, RepeatedLook>;

std::string repeated_header(std::uint64_t base_seed, const LookPlan& plan, const Grounds& grounds);
std::string line(const RepeatedLook& look);
RepeatedLook repeated_look_of(const std::string& line);  // throws Error for anything else
bool is_repeated_looks(const std::filesystem::path& path);
RepeatedLook take_repeated_look(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed,
                                std::uint64_t index);

// What was counted, by the share of new ground: what a simulated flight draws from.
class RepeatRates {
 public:
  static constexpr std::array kNewGround = {0.1, 0.25, 0.5, 0.75, 1.0, 1.5};  // middles of the bins
  struct Bin {
    int chance = 0, disc = 0, ring = 0;  // pairs
    CountedShare same_side;              // of true places: the errors of both are less than 90° apart
  };
  // Of peaks that were seen again: both weights of evidence, and how far apart the peaks were (on a ground of unit 1).
  struct Again {
    double first = 0, second = 0, moved_m = 0;
  };

  // origin: the run that the looks come from, in one line. Throws Error where no peak was seen again.
  RepeatRates(std::string origin, const RepeatedLooks& looks);
  // Of results that were kept with --resume. Throws Error for anything else.
  static RepeatRates reduced(const std::filesystem::path& path);
  // The form that the project stores. read() throws Error for anything else.
  static RepeatRates read(const std::filesystem::path& path);
  std::string text() const;
  std::string table() const;

  // Bounds, 95 %: that a chance peak is seen again; that the error of a true place is that of the last one (else it
  // lies on the same side half of the time).
  double again(double new_ground) const { return again_[bin_of(new_ground)]; }
  double error_stays(double new_ground) const { return stays_[bin_of(new_ground)]; }
  // The second weight of evidence of a peak that is seen again, and by how much it moved.
  struct Draw {
    double log_likelihood_ratio = 0, moved_m = 0;
  };
  Draw draw(double first_log_likelihood_ratio, Random& random) const;

  const Bin& bin(double new_ground) const { return bins_[bin_of(new_ground)]; }
  double slope() const { return slope_; }

 private:
  RepeatRates() = default;
  static std::size_t bin_of(double new_ground);
  void finish();

  std::string origin_;
  std::array<Bin, kNewGround.size()> bins_;
  std::vector<Again> pairs_;
  std::array<double, kNewGround.size()> again_{}, stays_{};
  double slope_ = 0, intercept_ = 0;
};

}  // namespace nadir::bench
