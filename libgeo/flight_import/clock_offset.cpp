#include "flight_import/clock_offset.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/quantile.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

constexpr double kTriggerJitter_s = 0.35;  // between a trigger and the time that the camera writes; of consumer cameras
constexpr std::size_t kMostTriggers = 100'000;  // bounds the votes
constexpr std::size_t kVotingPhotos = 60;       // evenly chosen; each votes with every trigger

struct TriggerMatching {
  double offset_s = 0;
  std::size_t matched = 0;
  double spread_s = 0;  // standard deviation of what remains
  std::vector<std::optional<std::size_t>> triggers;
};

// Photos and triggers in order, each trigger at most once: of two photos near one trigger the nearer has it.
TriggerMatching match_triggers(const std::vector<double>& times_s, const std::vector<CameraTrigger>& triggers,
                               double offset_s, double tolerance_s) {
  TriggerMatching result{.offset_s = offset_s, .matched = 0, .spread_s = 0, .triggers = {}};
  result.triggers.resize(times_s.size());
  std::vector<double> residuals_s;
  std::size_t next = 0;
  for (std::size_t i = 0; i < times_s.size(); ++i) {
    const double at_s = times_s[i] + offset_s;
    while (next < triggers.size() && triggers[next].time_s < at_s - tolerance_s) ++next;
    std::size_t best = next;
    for (std::size_t j = next; j < triggers.size() && triggers[j].time_s <= at_s + tolerance_s; ++j) {
      if (std::abs(triggers[j].time_s - at_s) < std::abs(triggers[best].time_s - at_s)) best = j;
    }
    if (best >= triggers.size() || std::abs(triggers[best].time_s - at_s) > tolerance_s) continue;
    result.triggers[i] = best;
    residuals_s.push_back(triggers[best].time_s - times_s[i]);
    next = best + 1;
  }
  result.matched = residuals_s.size();
  if (residuals_s.empty()) return result;
  double mean_s = 0;
  for (const double residual_s : residuals_s) mean_s += residual_s / static_cast<double>(residuals_s.size());
  double variance_s2 = 0;
  for (const double residual_s : residuals_s) {
    variance_s2 += (residual_s - mean_s) * (residual_s - mean_s) / static_cast<double>(residuals_s.size());
  }
  result.offset_s = mean_s;
  result.spread_s = std::sqrt(variance_s2);
  return result;
}

TriggerMatching refined_matching(const std::vector<double>& times_s, const std::vector<CameraTrigger>& triggers,
                                 double offset_s, double tolerance_s) {
  TriggerMatching best = match_triggers(times_s, triggers, offset_s, tolerance_s);
  for (int i = 0; i < 3; ++i) {
    TriggerMatching again = match_triggers(times_s, triggers, best.offset_s, tolerance_s);
    if (again.matched < best.matched) break;
    best = std::move(again);
  }
  return best;
}

// Offsets that many pairs vote for, most votes first, no two within the tolerance.
std::vector<double> voted_offsets(const std::vector<double>& times_s, const std::vector<CameraTrigger>& triggers,
                                  double tolerance_s, std::optional<double> expected_s) {
  constexpr std::size_t kMostOffsets = 40;
  constexpr double kAroundExpected_s = 30;
  std::vector<double> votes_s;
  const std::size_t step = std::max<std::size_t>(1, times_s.size() / kVotingPhotos);
  for (std::size_t i = 0; i < times_s.size(); i += step) {
    for (const CameraTrigger& trigger : triggers) {
      const double vote_s = trigger.time_s - times_s[i];
      if (!expected_s || std::abs(vote_s - *expected_s) < kAroundExpected_s) votes_s.push_back(vote_s);
    }
  }
  std::sort(votes_s.begin(), votes_s.end());
  struct Peak {
    double offset_s;
    std::size_t votes;
  };
  std::vector<Peak> peaks;
  std::size_t first = 0;
  for (std::size_t last = 0; last < votes_s.size(); ++last) {
    while (votes_s[last] - votes_s[first] > tolerance_s) ++first;
    peaks.push_back({(votes_s[first] + votes_s[last]) / 2, last - first + 1});
  }
  std::stable_sort(peaks.begin(), peaks.end(), [](const Peak& a, const Peak& b) { return a.votes > b.votes; });
  std::vector<double> offsets_s;
  for (const Peak& peak : peaks) {
    if (offsets_s.size() >= kMostOffsets) break;
    const bool near = std::any_of(offsets_s.begin(), offsets_s.end(),
                                  [&](double other_s) { return std::abs(other_s - peak.offset_s) < tolerance_s; });
    if (!near) offsets_s.push_back(peak.offset_s);
  }
  return offsets_s;
}

ClockOffset offset_of(const TriggerMatching& matching, std::size_t photos, double step_s) {
  const double count = static_cast<double>(matching.matched);
  return {.offset_s = matching.offset_s,
          .sigma_s = std::max({matching.spread_s, step_s / std::sqrt(12.0), 0.01}) / std::sqrt(count),
          .supporting = matching.matched,
          .from = fmt::format("{} of {} photos have a trigger in the log, {:.2f} s apart (1 σ)", matching.matched,
                              photos, matching.spread_s),
          .triggers = matching.triggers};
}

}  // namespace

ClockOffsetResult offset_from_triggers(const std::vector<double>& times_s, double step_s,
                                       const std::vector<CameraTrigger>& triggers, std::optional<double> expected_s) {
  constexpr std::size_t kFewest = 3;
  if (triggers.empty()) return {{}, "the log has no triggers"};
  if (triggers.size() > kMostTriggers) return {{}, fmt::format("{} triggers are no camera's", triggers.size())};
  if (times_s.size() < kFewest || triggers.size() < kFewest) {
    return {{}, fmt::format("{} photos and {} triggers are too few to tell", times_s.size(), triggers.size())};
  }
  const double tolerance_s = step_s / 2 + kTriggerJitter_s;
  std::vector<TriggerMatching> found;
  if (times_s.size() == triggers.size()) {  // one for one, if their times agree
    std::vector<double> differences_s;
    for (std::size_t i = 0; i < times_s.size(); ++i) differences_s.push_back(triggers[i].time_s - times_s[i]);
    TriggerMatching whole = refined_matching(times_s, triggers, median(std::move(differences_s)), tolerance_s);
    if (whole.matched == times_s.size()) {
      return {offset_of(whole, times_s.size(), step_s), {}};
    }
  }
  for (const double offset_s : voted_offsets(times_s, triggers, 2 * tolerance_s, expected_s)) {
    found.push_back(refined_matching(times_s, triggers, offset_s, tolerance_s));
  }
  std::stable_sort(found.begin(), found.end(), [](const TriggerMatching& a, const TriggerMatching& b) {
    return a.matched != b.matched ? a.matched > b.matched : a.spread_s < b.spread_s;
  });
  if (found.empty() || found.front().matched < std::max(kFewest, times_s.size() * 6 / 10)) {
    return {{},
            fmt::format("at best {} of {} photos have one of the log's {} triggers",
                        found.empty() ? 0 : found.front().matched, times_s.size(), triggers.size())};
  }
  const TriggerMatching& best = found.front();
  for (std::size_t i = 1; i < found.size(); ++i) {
    if (std::abs(found[i].offset_s - best.offset_s) < tolerance_s) continue;
    const std::size_t least = best.matched - std::min(best.matched, std::max<std::size_t>(2, times_s.size() / 20));
    const bool as_good = found[i].matched > least && found[i].spread_s < 2 * best.spread_s + 0.02;
    if (!as_good) continue;
    return {{},
            fmt::format("the cadence is too regular: {:.2f} s places {} of {} photos, and {:.2f} s places {}",
                        best.offset_s, best.matched, times_s.size(), found[i].offset_s, found[i].matched)};
  }
  return {offset_of(best, times_s.size(), step_s), {}};
}

namespace {

// The log's heading, unwrapped, on an even grid: looked up a million times.
class HeadingGrid {
 public:
  static constexpr double kStep_s = 0.1;
  static constexpr double kMaxGap_s = 2;

  explicit HeadingGrid(const std::vector<TimedAttitude>& attitudes) {
    constexpr double kLongest_s = 86'400;
    begin_s_ = attitudes.front().time_s;
    const double duration_s = std::min(attitudes.back().time_s - begin_s_, kLongest_s);
    const auto steps = static_cast<std::size_t>(duration_s / kStep_s) + 1;
    headings_rad_.reserve(steps);
    for (std::size_t i = 0; i < steps; ++i) {
      const auto attitude = attitude_at(attitudes, begin_s_ + static_cast<double>(i) * kStep_s, kMaxGap_s);
      headings_rad_.push_back(attitude ? attitude->heading_rad : std::nan(""));
    }
  }

  double begin_s() const { return begin_s_; }
  double end_s() const { return begin_s_ + kStep_s * static_cast<double>(headings_rad_.size() - 1); }

  // NaN outside, and in gaps.
  double at(double time_s) const {
    const double place = (time_s - begin_s_) / kStep_s;
    if (!(place >= 0) || place >= static_cast<double>(headings_rad_.size() - 1)) return std::nan("");
    const auto i = static_cast<std::size_t>(place);
    const double share = place - static_cast<double>(i);
    return headings_rad_[i] + share * wrap_pi(headings_rad_[i + 1] - headings_rad_[i]);
  }

 private:
  double begin_s_ = 0;
  std::vector<double> headings_rad_;
};

constexpr double kTurnSigma_rad = 0.035;  // of one seen turn, and of the log's: 2 degrees
constexpr double kTurnLimit = 5;          // sigmas at which the cost of one turn ends

struct TurnCost {
  double mean = std::numeric_limits<double>::infinity();  // per turn, in sigmas squared
  std::size_t used = 0, agreeing = 0;
};

TurnCost turn_cost(const std::vector<SeenTurn>& turns, const HeadingGrid& grid, double offset_s, double sigma_rad) {
  TurnCost cost;
  double sum = 0;
  for (const SeenTurn& turn : turns) {
    const double logged_rad = grid.at(turn.to_s + offset_s) - grid.at(turn.from_s + offset_s);
    if (std::isnan(logged_rad)) continue;
    const double sigmas = wrap_pi(logged_rad - turn.turn_rad) / sigma_rad;
    sum += std::min(sigmas * sigmas, kTurnLimit * kTurnLimit);
    if (std::abs(sigmas) < 3) ++cost.agreeing;
    ++cost.used;
  }
  // Photos outside of the log say nothing: an offset must keep most of them inside.
  if (cost.used * 10 >= turns.size() * 7) cost.mean = sum / static_cast<double>(cost.used);
  return cost;
}

}  // namespace

ClockOffsetResult offset_from_turns(const std::vector<SeenTurn>& turns, double step_s,
                                    const std::vector<TimedAttitude>& attitudes) {
  constexpr std::size_t kFewestTurns = 8;
  constexpr double kSearchStep_s = 0.25;
  constexpr std::size_t kMostSteps = 400'000;
  if (attitudes.size() < 2) return {{}, "the log has no attitude"};
  if (turns.size() < kFewestTurns) {
    return {{}, fmt::format("only {} pairs of pictures overlap enough to show a turn", turns.size())};
  }
  const HeadingGrid grid(attitudes);
  const double first_s = turns.front().from_s, last_s = turns.back().to_s;
  const double span_s = last_s - first_s;
  // Three tenths of the photos may lie outside.
  const double low_s = grid.begin_s() - first_s - 0.3 * span_s, high_s = grid.end_s() - last_s + 0.3 * span_s;
  if (!(high_s > low_s)) return {{}, "the photos span more time than the log"};
  // While turning, a rounded time is a heading that is off: 20 degrees per second are a sharp turn of a fixed wing.
  const double sigma_rad = hypotenuse(kTurnSigma_rad, step_s > 0.2 ? 0.1 * step_s : 0.0);
  struct Sample {
    double offset_s, cost;
  };
  std::vector<Sample> samples;
  const auto steps = std::min<std::size_t>(kMostSteps, static_cast<std::size_t>((high_s - low_s) / kSearchStep_s) + 1);
  for (std::size_t i = 0; i < steps; ++i) {
    const double offset_s = low_s + static_cast<double>(i) * kSearchStep_s;
    const TurnCost cost = turn_cost(turns, grid, offset_s, sigma_rad);
    if (std::isfinite(cost.mean)) samples.push_back({offset_s, cost.mean});
  }
  if (samples.empty()) return {{}, "at no offset do the photos lie inside of the log"};
  const auto cheaper = [](const Sample& a, const Sample& b) { return a.cost < b.cost; };
  Sample best = *std::min_element(samples.begin(), samples.end(), cheaper);
  for (double fine_s = kSearchStep_s / 2; fine_s > 0.005; fine_s /= 2) {
    for (const double offset_s : {best.offset_s - fine_s, best.offset_s + fine_s}) {
      const double cost = turn_cost(turns, grid, offset_s, sigma_rad).mean;
      if (cost < best.cost) best = {offset_s, cost};
    }
  }
  // What a turn is off by, at best, is the noise; costs are of independent pairs, so that their sum over σ² is a χ².
  const TurnCost at_best = turn_cost(turns, grid, best.offset_s, sigma_rad);
  const double scale2 = std::max(1.0, best.cost);
  const auto worse = [&](double cost) { return (cost - best.cost) * static_cast<double>(at_best.used) / scale2; };
  if (at_best.agreeing * 10 < at_best.used * 6) {
    return {{},
            fmt::format("the turns in the pictures are nowhere those of the log: at best {} of {} agree",
                        at_best.agreeing, at_best.used)};
  }
  // The offset's distribution around the best one, exp(-χ²/2): several dips side by side, which rounded times of photos
  // make, are one uncertain offset.
  constexpr double kFine_s = 0.05, kAround_s = 10;
  double mass = 0, mean_s = 0, variance_s2 = 0;
  for (const bool second : {false, true}) {
    for (double from_best_s = -kAround_s; from_best_s <= kAround_s; from_best_s += kFine_s) {
      const double weight = std::exp(-worse(turn_cost(turns, grid, best.offset_s + from_best_s, sigma_rad).mean) / 2);
      if (!second) {
        mass += weight;
        mean_s += weight * from_best_s;
      } else {
        variance_s2 += weight * (from_best_s - mean_s) * (from_best_s - mean_s) / mass;
      }
    }
    if (!second) mean_s /= mass;
  }
  const double offset_s = best.offset_s + mean_s, sigma_s = std::max(std::sqrt(variance_s2), 0.05);
  constexpr double kUselessSigma_s = 1.5;
  if (sigma_s > kUselessSigma_s) {
    return {{},
            fmt::format("the flight turns too little for its turns to tell: {:.1f} s ± {:.1f} s", offset_s, sigma_s)};
  }
  constexpr double kSure = 12;  // of χ²: 3.5 sigmas
  for (const Sample& sample : samples) {
    if (std::abs(sample.offset_s - best.offset_s) < kAround_s || worse(sample.cost) > kSure) continue;
    return {{},
            fmt::format("the flight repeats its turns: {:.1f} s and {:.1f} s fit alike", offset_s, sample.offset_s)};
  }
  return {ClockOffset{.offset_s = offset_s,
                      .sigma_s = sigma_s,
                      .supporting = at_best.agreeing,
                      .from = fmt::format("turns in {} of {} pairs of pictures are those of the log", at_best.agreeing,
                                          at_best.used),
                      .triggers = {}},
          {}};
}

}  // namespace nadir
