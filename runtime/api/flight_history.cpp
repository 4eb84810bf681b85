#include "api/flight_history.hpp"

#include <algorithm>
#include <utility>

namespace nadir {

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

}  // namespace nadir
