#include "replay/replayed_fixes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <string_view>
#include <utility>

#include "fixes/fix_stream.hpp"
#include "recorder/record_codec.hpp"

namespace nadir {
namespace {

constexpr double kLatest_s = 1e12;  // beyond: no time of a fix

std::string shown(double value) { return fmt::format("{}", value); }

std::string shown(const std::optional<double>& value) { return value ? shown(*value) : "none"; }

std::vector<std::pair<std::string_view, std::string>> fields_of(const FixRecord& fix) {
  const auto degrees = [&](double LonLat::*part) { return fix.place ? shown((*fix.place).*part) : "none"; };
  return {{"time_s", shown(fix.time_s)},
          {"unix_us", fmt::format("{}", fix.unix_us)},
          {"fix_type", fmt::format("{}", fix.fix_type)},
          {"source", std::string(name_of(fix.source))},
          {"lat_deg", degrees(&LonLat::lat_deg)},
          {"lon_deg", degrees(&LonLat::lon_deg)},
          {"msl_m", shown(fix.msl_m)},
          {"accuracy_m", shown(fix.accuracy_m)},
          {"vertical_accuracy_m", shown(fix.vertical_accuracy_m)},
          {"north_mps", shown(fix.north_mps)},
          {"east_mps", shown(fix.east_mps)},
          {"down_mps", shown(fix.down_mps)},
          {"speed_accuracy_mps", shown(fix.speed_accuracy_mps)}};
}

std::optional<FixComparison::Difference> difference(const FixRecord& recorded, const FixRecord& replayed) {
  const auto bits = [](FixRecord fix) {
    fix.gps.reset();
    return encode(Record(std::move(fix)));
  };
  if (bits(recorded) == bits(replayed)) return std::nullopt;
  const auto wanted = fields_of(recorded), found = fields_of(replayed);
  const auto [at, other] = std::ranges::mismatch(wanted, found);
  // Bits may differ where the text does not: two kinds of NaN.
  if (at == wanted.end()) return FixComparison::Difference{recorded.time_s, "fix", "other bits", "other bits"};
  return FixComparison::Difference{recorded.time_s, std::string(at->first), at->second, other->second};
}

// Recorded fixes by their time in microseconds.
using FixesByTime = std::map<std::int64_t, const FixRecord*>;

class FixReplay {
 public:
  FixReplay(const RecordedFlight& recorded, const std::vector<EstimateRecord>& estimates, const TerrainSurface* terrain)
      : recorded_(recorded), terrain_(terrain) {
    for (const FixInputRecord& inputs : recorded.fix_inputs) turns_.emplace(inputs.number, &inputs);
    for (const EstimateRecord& estimate : estimates) {
      if (estimate.index < recorded.flight.frames.size()) estimates_[estimate.index].push_back(&estimate);
    }
    for (const EstimateRecord& estimate : recorded.estimates) flown_[estimate.index].push_back(&estimate);
    for (const FixRecord& fix : recorded.fixes) {
      const bool timed = fix.time_s >= 0 && fix.time_s < kLatest_s;
      if (!timed || !fixes_.emplace(std::llround(fix.time_s * 1e6), &fix).second) untimed_.push_back(&fix);
    }
  }

  ReplayedFixes run() {
    std::string end = "their inputs are not in the recording (/fix_input)";
    for (const auto& [number, inputs] : turns_) {
      if (const auto broken = break_before(*inputs)) {
        end = *broken;
        break;
      }
      ++next_number_;
      last_us_ = inputs->time_us;
      turn(*inputs);
    }
    leave_out_the_rest(end);
    return std::move(result_);
  }

 private:
  // Why the stream cannot be continued with this turn.
  std::optional<std::string> break_before(const FixInputRecord& inputs) const {
    if (inputs.number != next_number_) {
      return fmt::format("turns {} to {} of /fix_input are missing", next_number_, inputs.number - 1);
    }
    if (last_us_ && inputs.time_us <= *last_us_) {
      return fmt::format("turn {} of /fix_input is not later than the one before", inputs.number);
    }
    if (inputs.missing != 0) {
      return fmt::format("turn {} of /fix_input lacks {} inputs: more came than are recorded", inputs.number,
                         inputs.missing);
    }
    std::int64_t before_us = last_us_.value_or(std::numeric_limits<std::int64_t>::min());
    for (const FixInputRecord::Input& input : inputs.inputs) {
      if (input.time_us < before_us)
        return fmt::format("inputs of turn {} of /fix_input are not in order", inputs.number);
      before_us = input.time_us;
      const auto* which = std::get_if<FixInputRecord::ArrivedEstimate>(&input.what);
      if (which == nullptr) continue;
      const EstimateRecord* estimate = find(estimates_, *which);
      if (estimate == nullptr) return fmt::format("the estimate of frame {} is not in the replay", which->index);
      if (recorded_.missing_between != 0 && !reproduced(*which, *estimate)) {
        return fmt::format(
            "the estimate of frame {} is not reproduced, and {} records of /anchor and /hint are missing", which->index,
            recorded_.missing_between);
      }
    }
    return std::nullopt;
  }

  void turn(const FixInputRecord& inputs) {
    for (const FixInputRecord::Input& input : inputs.inputs) {
      if (const auto* attitude = std::get_if<FixInputRecord::Attitude>(&input.what)) {
        stream_.on_input(input.time_us, *attitude);
      } else if (const auto* force = std::get_if<FixInputRecord::Acceleration>(&input.what)) {
        stream_.on_input(input.time_us, *force);
      } else {
        const auto& which = std::get<FixInputRecord::ArrivedEstimate>(input.what);
        if (const auto estimate = vision(*find(estimates_, which))) stream_.on_input(input.time_us, which, *estimate);
      }
    }
    const std::optional<DueFix> due = stream_.turn(inputs.time_us, inputs.unix_us, inputs.status);
    const auto recorded = fixes_.find(inputs.time_us);
    const FixRecord* sent = recorded == fixes_.end() ? nullptr : recorded->second;
    std::optional<FixRecord> replayed;
    if (due && inputs.sent) {
      replayed = fix_record(*due);
      if (sent != nullptr) replayed->gps = sent->gps;
      result_.fixes.push_back(*replayed);
    }
    if (sent != nullptr) {
      compare(*sent, replayed);
      fixes_.erase(recorded);
    } else if (inputs.sent) {
      leave_out(static_cast<double>(inputs.time_us) * 1e-6, "the fix was sent, but is not in the recording (/fix)");
    }
  }

  void compare(const FixRecord& sent, const std::optional<FixRecord>& replayed) {
    FixComparison& comparison = result_.comparison;
    ++comparison.compared;
    left_out_ = false;
    const auto found = replayed ? difference(sent, *replayed)
                                : FixComparison::Difference{sent.time_s, "fix", fields_of(sent)[2].second, "none"};
    if (!found) ++comparison.identical;
    if (found && !comparison.first) comparison.first = found;
  }

  void leave_out(double time_s, const std::string& reason) {
    auto& intervals = result_.comparison.not_compared;
    if (!left_out_ || intervals.back().reason != reason) intervals.push_back({time_s, time_s, 0, reason});
    left_out_ = true;
    intervals.back().to_s = time_s;
    ++intervals.back().fixes;
  }

  // What was sent up to the last turn has a turn of its own, or there is a contradiction in the recording.
  void leave_out_the_rest(const std::string& reason) {
    for (const auto& [time_us, fix] : fixes_) {
      if (last_us_ && time_us <= *last_us_) {
        compare(*fix, std::nullopt);
      } else {
        leave_out(fix->time_s, reason);
      }
    }
    for (const FixRecord* fix : untimed_) leave_out(fix->time_s, "their times are none, or those of others");
  }

  using ByFrame = std::map<std::uint64_t, std::vector<const EstimateRecord*>>;

  static const EstimateRecord* find(const ByFrame& estimates, const FixInputRecord::ArrivedEstimate& which) {
    const auto frame = estimates.find(which.index);
    const std::size_t place = which.late ? 1 : 0;
    if (frame == estimates.end() || frame->second.size() <= place) return nullptr;
    return frame->second[place];
  }

  // False as well when the recording lacks it.
  bool reproduced(const FixInputRecord::ArrivedEstimate& which, const EstimateRecord& replayed) const {
    const EstimateRecord* flown = find(flown_, which);
    return flown != nullptr && compare_estimates({*flown}, {replayed}).same == 1;
  }

  std::optional<VisionEstimate> vision(const EstimateRecord& record) const {
    const Estimate& estimate = record.estimate;
    std::optional<double> ground_msl_m;
    if (estimate.position && terrain_ != nullptr) ground_msl_m = terrain_->msl_m(*estimate.position);
    return vision_estimate(estimate, record.state, recorded_.flight.frames.at(record.index).time_s, ground_msl_m,
                           recorded_.session.localizer.integrity_risk);
  }

  const RecordedFlight& recorded_;
  const TerrainSurface* terrain_;
  std::map<std::uint64_t, const FixInputRecord*> turns_;  // by their number
  ByFrame estimates_, flown_;                             // of the replay, and as recorded
  FixesByTime fixes_;                                     // recorded, and not yet looked at
  std::vector<const FixRecord*> untimed_;                 // recorded, of no turn
  FixStream stream_;
  std::uint64_t next_number_ = 0;
  std::optional<std::int64_t> last_us_;
  bool left_out_ = false;  // the last fix
  ReplayedFixes result_;
};

}  // namespace

ReplayedFixes replay_fixes(const RecordedFlight& recorded, const std::vector<EstimateRecord>& estimates,
                           const TerrainSurface* terrain) {
  return FixReplay(recorded, estimates, terrain).run();
}

std::string text_of(const FixComparison::Difference& difference) {
  return fmt::format("first fix that differs: at {:.6f} s, {}: recorded {}, replayed {}", difference.time_s,
                     difference.field, difference.recorded, difference.replayed);
}

std::string text_of(const FixComparison::Interval& interval) {
  return fmt::format("not compared: {} {} from {:.1f} s to {:.1f} s: {}", interval.fixes,
                     interval.fixes == 1 ? "fix" : "fixes", interval.from_s, interval.to_s, interval.reason);
}

}  // namespace nadir
