// What happens in a flight, told to everybody who must know: the recorder, the readers of the API, the operator.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "api/flight_view.hpp"
#include "recorder/recorder.hpp"
#include "service/service_machine.hpp"

namespace nadir {

class FlightJournal {
 public:
  // recorder: may be null, must outlive this.
  explicit FlightJournal(Recorder* recorder) : recorder_(recorder) {}

  void state(const ServiceEvent& event);
  void note(double time_s, EventSeverity severity, const std::string& kind, const std::string& text);

  const EventRing& events() const { return events_; }

 private:
  Recorder* recorder_;
  EventRing events_;
};

EventSeverity severity_of(OperatorSeverity severity);

}  // namespace nadir
