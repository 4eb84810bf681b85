// Measured looks, to draw from: what the matcher made of a frame in a window, without frame or map. The table keeps of
// each look which kind of window and picture it had, over which ground, and what came out: nothing, the true place, or
// a chance peak, with its weight of evidence and its errors. Of weak chance peaks, which are many, one stands for some.
//
// Tail. No chance peak was stronger than the strongest, of n looks in a kind of window. A rarer one may be: with the
// upper bound of that rate (95 %) a look is one with ln ℓ = the strongest + Exp(1). For if a likelihood ratio is what
// it claims to be, P(ratio > t) <= 1 / t among chance peaks. n is the effective number: looks of one picture count for
// as much as their scatter says.
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "counted_share.hpp"
#include "look.hpp"

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
struct LookFinding {
  LookOutcome outcome = LookOutcome::none;
  double log_likelihood_ratio = 0;
  double error_m = 0;  // of the position; of a chance peak only where it is near the true place
  CandidateSigmas sigmas;
  // The second best place, where it may be the true one.
  struct Rival {
    double log_likelihood_ratio = 0;
    double apart_m = 0;     // from the candidate; 0: there is none
    double error_m = 0;     // only where it is near the true place
    double searched_m = 0;  // one-axis σ that it has beside the candidate's
  } rival;
  bool has_rival() const { return rival.apart_m > 0; }
};
struct MeasuredLook {
  std::string ground, picture;
  WindowKind window = WindowKind::holds_place;
  double radius_m = 0;
  LookFinding found;
  int count = 1;  // of looks that it stands for
};

MeasuredLook measured(const Look& look);
// Whether the tilt was known as well as a flight controller knows it: what a flight draws from. Of looks without a
// candidate nobody knows it any more; they count.
bool tilt_was_measured(const Look& look);

// Rows that are drawn with their counts.
struct LookPool {
  std::vector<const MeasuredLook*> rows;
  std::vector<int> counted;  // counts of the rows up to each one
  int size() const { return counted.empty() ? 0 : counted.back(); }
  void add(const MeasuredLook& look);
};

// Of a kind of window: chance peaks beyond the strongest of the table, among all looks.
struct LookTail {
  CountedShare beyond;
  LookFinding strongest;  // of the table
  double rate = 1;        // upper bound
};

// What a flight over one ground, with one kind of picture, draws its looks from.
struct LookPools {
  static constexpr std::array kRadii_m = {60.0, 120.0, 250.0, 800.0};
  // The rows for a kind of window and a radius: of this ground where it has enough, else of more grounds.
  std::array<std::array<const LookPool*, kRadii_m.size()>, kWindowKinds.size()> pools{};
  const std::array<LookTail, kWindowKinds.size()>* tails = nullptr;

  LookFinding draw(WindowKind window, double radius_m, Random& random) const;
};

class MeasuredLooks {
 public:
  static constexpr int kLeastLooks = 8;
  using Beyond = std::array<CountedShare, kWindowKinds.size()>;

  // origin: the run that the looks come from, in one line. Throws Error where a kind of window has no look at all.
  MeasuredLooks(std::string origin, std::vector<MeasuredLook> looks, const Beyond& beyond);
  // Of looks with telemetry as a flight has it (tilt_was_measured()).
  static MeasuredLooks reduced(std::string origin, const Looks& looks);
  MeasuredLooks(MeasuredLooks&&) = default;  // the pools point into it
  // The form that the project stores, of a few dozen bytes a look. Throws Error for lines that cannot be read.
  static MeasuredLooks read(const std::filesystem::path& path);
  std::string text() const;
  std::string summary() const;  // a table for people: how many, and the tails

  const std::string& origin() const { return origin_; }
  const std::vector<MeasuredLook>& all() const { return looks_; }
  const std::array<LookTail, kWindowKinds.size()>& tails() const { return *tails_; }
  // Grounds with enough looks of that kind of picture in windows that hold the place. registered: those whose map and
  // truth fit together to a few metres, or the others: pairs of satellite pictures that nobody has checked.
  std::vector<std::string> grounds_with(const std::string& picture, bool registered) const;
  LookPools pools(const std::string& ground, const std::string& picture) const;

 private:
  const LookPool& pool(const std::string& ground, const std::string& picture, WindowKind window, double radius_m) const;

  std::string origin_;
  std::vector<MeasuredLook> looks_;
  std::unique_ptr<std::array<LookTail, kWindowKinds.size()>> tails_;
  std::map<std::string, LookPool> by_key_;
};

}  // namespace nadir::bench
