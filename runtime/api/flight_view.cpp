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

void EventRing::add(double time_s, EventSeverity severity, std::string kind, std::string text) {
  if (events_.size() >= capacity_) events_.erase(events_.begin());
  events_.push_back({++last_id_, time_s, severity, std::move(kind), std::move(text)});
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
