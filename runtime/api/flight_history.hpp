// What the service remembers of its own flight for its readers: the last events and the track of the last minutes.
// Bounded, so that a long flight costs no more than a short one.
#pragma once

#include <cstddef>
#include <vector>

#include "api/flight_view.hpp"

namespace nadir {

class EventRing {
 public:
  explicit EventRing(std::size_t capacity = 100) : capacity_(capacity) {}

  void add(double time_s, EventSeverity severity, std::string kind, std::string text);
  const std::vector<FlightEvent>& events() const { return events_; }  // oldest first

 private:
  std::size_t capacity_;
  std::uint64_t last_id_ = 0;
  std::vector<FlightEvent> events_;
};

// At most one point in each spacing_s; points older than length_s are forgotten.
class FlightTrail {
 public:
  explicit FlightTrail(double length_s = 600, double spacing_s = 1) : length_s_(length_s), spacing_s_(spacing_s) {}

  void add(const TrackPoint& point);
  const std::vector<TrackPoint>& points() const { return points_; }  // oldest first

 private:
  double length_s_;
  double spacing_s_;
  std::vector<TrackPoint> points_;
};

}  // namespace nadir
