#include "api/flight_view.hpp"

#include <algorithm>
#include <utility>

namespace nadir {

std::string_view name_of(GpsJudgement judgement) {
  switch (judgement) {
    case GpsJudgement::unknown: return "unknown";
    case GpsJudgement::good: return "good";
    case GpsJudgement::denied: return "denied";
    case GpsJudgement::spoofed: return "spoofed";
  }
  return "unknown";
}

std::string_view name_of(RecorderState state) {
  switch (state) {
    case RecorderState::off: return "off";
    case RecorderState::recording: return "recording";
    case RecorderState::limited: return "limited";
    case RecorderState::failed: return "failed";
  }
  return "failed";
}

std::string_view name_of(EventSeverity severity) {
  switch (severity) {
    case EventSeverity::info: return "info";
    case EventSeverity::warning: return "warning";
    case EventSeverity::critical: return "critical";
  }
  return "critical";
}

namespace {

// The text without its figures.
std::string wording(std::string_view text) {
  std::string words;
  for (const char c : text) {
    const bool figure = (c >= '0' && c <= '9') || c == '.';
    if (!figure) words += c;
  }
  return words;
}

}  // namespace

void EventRing::add(double time_s, EventSeverity severity, std::string kind, std::string text) {
  FlightEvent event{++last_id_, 0, 1, time_s, severity, std::move(kind), std::move(text)};
  const auto repeated = std::find_if(events_.begin(), events_.end(), [&](const FlightEvent& earlier) {
    return earlier.severity == event.severity && earlier.kind == event.kind &&
           time_s - earlier.time_s < repeat_window_s_ && wording(earlier.text) == wording(event.text);
  });
  if (repeated != events_.end()) {
    event.replaces = repeated->id;
    event.count = repeated->count + 1;
    events_.erase(repeated);
  } else if (events_.size() >= capacity_) {
    gone_ = std::max(gone_, events_.front().id);
    events_.erase(events_.begin());
  }
  events_.push_back(std::move(event));
}

void FlightTrail::add(const TrackPoint& point) {
  if (!points_.empty() && point.time_s < points_.back().time_s + spacing_s_) return;
  points_.push_back(point);
  const auto young = std::find_if(points_.begin(), points_.end(),
                                  [&](const TrackPoint& old) { return old.time_s >= point.time_s - length_s_; });
  points_.erase(points_.begin(), young);
}

void FlightBoard::publish(FlightView view) {
  view.version = ++versions_;
  newest_.put(std::move(view));
}

std::shared_ptr<const FlightView> FlightBoard::snapshot() const {
  const std::lock_guard lock(readers_);
  if (std::unique_ptr<FlightView> newer = newest_.take()) seen_ = std::move(newer);
  return seen_;
}

}  // namespace nadir
