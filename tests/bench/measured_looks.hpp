// Measured looks, to draw from: what the matcher made of a frame in a window, without frame or map. The table keeps of
// each look which kind of window and picture it had, over which ground, and what came out: nothing, the true place, or
// a chance peak, with its weight of evidence and its errors.
//
// And how looks in a row depend on each other: a chance peak may be seen again, at the same place, by the next frame
// that shows the same ground. How often, was counted (repeated_looks.hpp).
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "look.hpp"
#include "look_rates.hpp"

namespace nadir::bench {

// One-axis sigmas of a candidate's position as the belief takes them (map_look.hpp).
struct CandidateSigmas {
  double solved_m = 0;           // of the solver, with its factor
  double wrong_consensus_m = 0;  // where most patches matched something else
  double unmodelled_m = 0;       // grows with height
  double variance_m2() const {
    return solved_m * solved_m + wrong_consensus_m * wrong_consensus_m + unmodelled_m * unmodelled_m;
  }
};
CandidateSigmas sigmas_of(const Look& look);

enum class WindowKind { holds_place, elsewhere, other_map };
inline constexpr std::array kWindowKinds = {WindowKind::holds_place, WindowKind::elsewhere, WindowKind::other_map};
enum class LookOutcome { none, place, chance };

// What a ground's distances are divided by: NAIP's pixels are large.
double unit_of(const std::string& ground);

// Distances are those of a ground of unit 1 (look_grounds.hpp).
struct MeasuredLook {
  std::string ground, picture;
  WindowKind window = WindowKind::holds_place;
  double radius_m = 0;
  LookOutcome outcome = LookOutcome::none;
  double log_likelihood_ratio = 0;
  double error_m = 0;  // of the position; of a chance peak only where it is near the true place
  CandidateSigmas sigmas;
};

MeasuredLook measured(const Look& look);
// Whether the tilt was known as well as a flight controller knows it: what a flight draws from. Of looks without a
// candidate nobody knows it any more; they count.
bool tilt_was_measured(const Look& look);

// What a flight over one ground, with one kind of picture, draws its looks from.
struct LookPools {
  static constexpr std::array kRadii_m = {60.0, 120.0, 250.0, 800.0};
  // The rows for a kind of window and a radius: of this ground where it has enough, else of more grounds.
  std::array<std::array<const std::vector<const MeasuredLook*>*, kRadii_m.size()>, kWindowKinds.size()> rows{};

  const MeasuredLook& draw(WindowKind window, double radius_m, Random& random) const;
};

class MeasuredLooks {
 public:
  static constexpr std::size_t kLeastRows = 8;

  // origin: the run that the looks come from, in one line. Throws Error where a kind of window has no look at all.
  MeasuredLooks(std::string origin, std::vector<MeasuredLook> looks);
  MeasuredLooks(MeasuredLooks&&) = default;  // the pools point into it
  // The form that the project stores, of a few dozen bytes a look. Throws Error for lines that cannot be read.
  static MeasuredLooks read(const std::filesystem::path& path);
  std::string text() const;

  const std::string& origin() const { return origin_; }
  const std::vector<MeasuredLook>& all() const { return looks_; }
  // Grounds with enough looks of that kind of picture in windows that hold the place. registered: those whose map and
  // truth fit together to a few metres, or the others: pairs of satellite pictures that nobody has checked.
  std::vector<std::string> grounds_with(const std::string& picture, bool registered) const;
  LookPools pools(const std::string& ground, const std::string& picture) const;

 private:
  const std::vector<const MeasuredLook*>& pool(const std::string& ground, const std::string& picture, WindowKind window,
                                               double radius_m) const;

  std::string origin_;
  std::vector<MeasuredLook> looks_;
  std::map<std::string, std::vector<const MeasuredLook*>> by_key_;
};

}  // namespace nadir::bench
