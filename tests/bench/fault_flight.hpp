// A flight with one fault, look by look, without pictures: the belief over places (estimation/belief.hpp) and a filter
// of two dimensions, with looks drawn from measured ones. A look costs microseconds, so that misleading positions can
// be counted where they are rare (splitting.hpp).
//
// Model. The truth is the origin; the track is off by e. Between two looks the aircraft flies a share of its footprint
// (new ground), and e drifts: by a share of the way that is the same all flight long (height, lens and heading are not
// known better) and by a step of a random walk. The filter estimates position and drift, as the localizer's estimates
// height and heading. A look searches a
// window around the track as the localizer would (search_window.hpp). What it finds is a measured look of the same kind
// of window and picture over the same ground: nothing; the true place, with its measured error in a random direction;
// or a chance peak, uniform in the window, or beside the truth at its measured distance; and with it the second best
// place, as far from both as it was measured, on either side. The belief weighs them; when it accepts, the filter is
// updated with the covariance that the localizer would use.
//
// Looks in a row depend on each other: a chance peak is seen again at the same place with the upper bound of the
// counted probability, displaced and with a weight of evidence as when counted (repeated_looks.hpp), and so is its
// rival, and that of the true place; an error of the true place, in σ, stays with the ground that both show. The map as
// a whole is off by its own σ.
//
// A wrong motion is one that few pixels agreed on by chance, where the velocity is known so badly that the prediction
// does not refuse it (tracking_state.hpp): it ends anywhere in the frame where the prediction may be, and the belief
// doubts it as the localizer's does. Frames hardly overlap then, so that the next ones may have no motion: for as many
// looks as foreign frames the velocity leads on, by as much each time, whatever anchors say of it. The next motion is
// right.
//
// Onset. A stretch with a fault begins with the flight, at a start that may be wrong; or in flight: a stretch without a
// fault comes before it, of which nothing counts. Wide starts are rare and lead to most misleading flights, so half of
// the starts are drawn from a wider distribution, and each flight has the weight that makes up for it.
//
// Misleading at a look: there is a protection level within the alert limit, and the error is larger. Hazardously: the
// error is beyond the alert limit as well.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "estimation/belief.hpp"
#include "estimation/search_window.hpp"
#include "measured_looks.hpp"
#include "repeated_looks.hpp"

namespace nadir::bench {

enum class FlightFault {
  none,
  unchecked_pairs,  // none, over pairs of satellite pictures whose registration nobody has checked
  start_500,        // a person's start, 150 to 500 m off, σ claimed 50 m
  start_2000,       // 500 to 2000 m off
  other_map,        // the map does not show the place: mirrored, turned, of another region, all changed
  start_and_map,    // both
  half_changed,
  clouds,
  blur,
  night,
  map_50,  // the map is displaced
  map_200,
  map_1000,
  foreign_frames,  // one to five frames of another place, 50 to 500 m off
  wrong_anchor,    // the track was moved to a wrong place, 50 to 500 m off; counted from a minute later
  odometry,        // each displacement is measured 5 % too long
  wrong_motion,    // few pixels agreed on a motion by chance, and its velocity leads on while frames hardly overlap
};

enum class Onset { start, in_flight };

struct FaultKind {
  std::string name;  // in tables
  std::string code;  // in files and on the command line
  FlightFault fault;
  Onset onset = Onset::start;
};
std::span<const FaultKind> fault_kinds();
// Flights are numbered: a number says which kind they have, and which of its repetitions they are. A kind that is added
// leaves the numbers of the others as they are, and with them the stored results.
const FaultKind& kind_of(std::uint64_t number);
std::uint64_t number_of(const FaultKind& kind, std::uint64_t repetition);  // of fault_kinds()
bool is_fault_kind(std::string_view code);
const FaultKind& fault_kind(std::string_view code);  // throws Error

struct FlightLimits {
  double minutes = 5;  // that the fault lasts
  double alert_limit_m = 100;
  double integrity_risk = parameters::belief::kIntegrityRisk;
};

class FaultFlight {
 public:
  enum Event { misleading, hazardous, kEvents };

  struct State {
    std::array<bool, kEvents> events{};
    double weight = 1;  // of this flight among all: true over drawn density of its start
    // Fixed for the flight.
    const std::string* ground = nullptr;
    LookPools pools;                                        // of the pictures as they are now
    Eigen::Vector2d map_shift_m = Eigen::Vector2d::Zero();  // what lies at p appears at p + shift
    double happens_at_s = 0;                                // what is about some frames alone
    Eigen::Vector2d foreign_m = Eigen::Vector2d::Zero();
    int foreign_frames = 0;  // left to come
    int astray_looks = 0;    // left to come: led by a wrong motion, until the next right one
    bool led_astray = false;
    Eigen::Vector2d astray_share = Eigen::Vector2d::Zero();  // of the way, from look to look
    // The estimator.
    PlaceBelief belief{1, {}};
    Eigen::Vector4d error = Eigen::Vector4d::Zero();  // of the position, m, and of the drift, m/m
    Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
    Eigen::Vector2d error_m() const { return error.head<2>(); }
    Eigen::Matrix2d covariance_m2() const { return covariance.topLeftCorner<2, 2>(); }
    bool anchored = false;
    bool stands = true;
    double since_anchor_m = 0;
    SearchWindow window{parameters::search_window::kMinRadius_m, parameters::search_window::kMaxRadius_m, std::nullopt};
    // Time since the fault began, and what the last look found.
    double time_s = 0;
    bool begun = false;  // the fault
    double minute_ends_s = 0;
    double new_ground = 1;
    std::optional<LookCandidate> last_chance, last_rival;
    std::optional<Eigen::Vector2d> alike_m;  // from the place to the one beside it that looks like it
    CandidateSigmas last_chance_sigmas;
    std::optional<Eigen::Vector2d> place_error_sigmas;
    bool last_foreign = false;
    // What is published.
    std::optional<double> hpl_m;
    int looks = 0, usable = 0, usable_30 = 0;
  };

  // Which paths score() prefers: those that are most likely wrong, or those that nobody is warned of by a level beyond
  // the alert limit. Different routes lead to the same event, and each guide misses some of them.
  enum class Guide { doubt, unwarned_doubt };

  // target: the event that score() leads to. wide_starts: share of starts that are drawn from the wider distribution.
  FaultFlight(const MeasuredLooks& looks, const RepeatRates& repeats, const FaultKind& kind, const FlightLimits& limits,
              Event target, double wide_starts = 0, Guide guide = Guide::doubt);

  State begin(Random& random) const;
  void advance(State& state, Random& random) const;
  // Log odds, against all the rest, of the strongest hypothesis that is not the truth: of weight × (1 - exp(-d² /
  // 2σ²)), where d is its distance from the truth; for the hazardous event σ is widened, so that only far ones count.
  double score(const State& state) const;
  bool ended(const State& state) const { return state.time_s >= 60 * limits_.minutes; }

 private:
  void begin_fault(State& state, Random& random) const;
  void mislead(State& state, double way_m, Random& random) const;

  const MeasuredLooks& looks_;
  const RepeatRates& repeats_;
  FlightFault fault_;
  Onset onset_;
  FlightLimits limits_;
  Event target_;
  double wide_starts_;
  Guide guide_;
  std::string picture_;
  std::vector<std::string> grounds_;
};

}  // namespace nadir::bench
