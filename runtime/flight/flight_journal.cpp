#include "flight/flight_journal.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <utility>

namespace nadir {

EventSeverity severity_of(OperatorSeverity severity) {
  if (severity <= OperatorSeverity::error) return EventSeverity::critical;
  return severity == OperatorSeverity::warning ? EventSeverity::warning : EventSeverity::info;
}

std::string text_of(const FixJumped& jumped) { return fmt::format("position jumps by {:.0f} m", jumped.distance_m); }

std::string text_of(const PartReported& reported) {
  if (reported.failure.empty()) return fmt::format("works again, after {:.0f} s", reported.off_s);
  return "failed, and is tried again: " + on_one_line(reported.failure);
}

std::string on_one_line(const std::string& failure) {
  std::string text;
  bool blank = false;
  for (const char c : failure) {
    if (c == '\n') text += ';';
    if ((c == ' ' || c == '\n') && blank) continue;
    blank = c == ' ' || c == '\n';
    text += blank ? ' ' : c;
  }
  return text;
}

void FlightJournal::on_event(double time_s, const OnboardEvent& event) {
  const auto enter = [&](const auto& known) {
    if constexpr (requires { on(time_s, known); }) on(time_s, known);
  };
  std::visit(enter, event);
}

void FlightJournal::note(double time_s, EventSeverity severity, const std::string& kind, const std::string& text) {
  add(time_s, severity, kind, text);
  if (recorder_ == nullptr) return;
  HealthRecord record{severity == EventSeverity::info, {}, {kind + ": " + text}};
  if (severity == EventSeverity::critical) record.measures.emplace_back(kAlarmMeasure, 1);
  recorder_->record(std::move(record));
}

void FlightJournal::add(double time_s, EventSeverity severity, const std::string& kind, const std::string& text) {
  events_.add(time_s, severity, kind, text);
  if (severity == EventSeverity::critical) alarms_.add(time_s, severity, kind, text);
}

void FlightJournal::on(double, const StateTransition& transition) {
  const ReasonText& reason = text_of(transition.reason);
  add(transition.time_s, severity_of(reason.severity), "state", transition.text);
  if (recorder_ == nullptr) return;
  recorder_->record(StateRecord{std::string(name_of(transition.from)), std::string(name_of(transition.to)),
                                std::string(reason.name) + ": " + transition.text});
}

void FlightJournal::on(double time_s, const CameraFailed& failed) {
  note(time_s, EventSeverity::warning, "camera", failed.reason);
}

void FlightJournal::on(double time_s, const PartReported& reported) {
  note(time_s, reported.failure.empty() ? EventSeverity::info : EventSeverity::warning, reported.part,
       text_of(reported));
}

void FlightJournal::on(double time_s, const TileCorrupt& tile) {
  add(time_s, EventSeverity::critical, "tile",
      fmt::format("{}: tile {}: {}; the map has a hole there", tile.code, to_text(tile.tile), tile.reason));
  if (recorder_ != nullptr) recorder_->record(TileRecord{tile.tile, tile.code, tile.reason});
}

// The first of a row; the view counts all of them.
void FlightJournal::on(double time_s, const MatchFailed& failed) {
  if (!match_failed_) note(time_s, EventSeverity::warning, "match", "matching to the map failed: " + failed.reason);
  match_failed_ = true;
}

void FlightJournal::on(double time_s, const LocalizedFrame& frame) {
  if (!match_failed_ || !frame.late || frame.report.anchor.verdict == AnchorVerdict::not_tried) return;
  match_failed_ = false;
  note(time_s, EventSeverity::info, "match", "matching to the map works again");
}

void FlightJournal::on(double time_s, const FixJumped& jumped) {
  note(time_s, EventSeverity::warning, "fix", text_of(jumped));
}

void FlightJournal::on(double time_s, const PositionHinted& hint) {
  note(time_s, EventSeverity::info, "hint",
       fmt::format("{}: within {:.0f} m of {:.5f}, {:.5f}", hint.source, hint.radius_m, hint.place.lat_deg,
                   hint.place.lon_deg));
}

void FlightJournal::on(double time_s, const HintRefused& refused) {
  note(time_s, EventSeverity::warning, "hint", fmt::format("of {} refused: {}", refused.source, refused.reason));
}

void FlightJournal::on(double time_s, const LinkRivalSeen& rival) {
  note(time_s, EventSeverity::critical, "link",
       fmt::format(
           "another sender claims to be the autopilot: {} frames from another address; our fixes stay with the first",
           rival.frames));
}

void FlightJournal::on(double time_s, const ParameterChanged& changed) {
  if (changed.restored()) {
    note(time_s, EventSeverity::info, "autopilot",
         fmt::format("{} is {} again, as it was provisioned", changed.name, changed.expected));
    return;
  }
  note(time_s, EventSeverity::critical, "autopilot",
       fmt::format("{} is {}; it was provisioned as {}: provision again, or set it back", changed.name, changed.found,
                   changed.expected));
}

void FlightJournal::on(double time_s, const ParametersMissing& missing) {
  note(time_s, EventSeverity::critical, "autopilot",
       fmt::format("{}: the autopilot {}; it was provisioned with {}: provision again", fmt::join(missing.names, ", "),
                   missing.all ? "answers for no parameter" : "does not answer, and answers for others",
                   missing.names.size() == 1 ? "it" : "them"));
}

void FlightJournal::on(double time_s, const AutopilotVersionChanged& changed) {
  if (changed.as_expected) {
    note(time_s, EventSeverity::info, "autopilot",
         fmt::format("PX4 is {}, and was provisioned as {}", changed.version, changed.expected));
    return;
  }
  note(time_s, EventSeverity::critical, "autopilot",
       fmt::format("PX4 is {}; it was provisioned as {}, which takes our position by other parameters: provision again",
                   changed.version, changed.expected));
}

void OperatorTexts::add(TextSeverity severity, std::string text) {
  if (text.empty()) return;
  texts_.push_back({severity, std::move(text)});
  if (texts_.size() <= capacity_) return;
  texts_.pop_front();
  ++dropped_;
}

void OperatorTexts::deliver(const Listener& listener) {
  for (const Text& pending : std::exchange(texts_, {})) listener(pending.severity, pending.text);
}

}  // namespace nadir
