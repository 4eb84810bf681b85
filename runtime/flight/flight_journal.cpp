#include "flight/flight_journal.hpp"

namespace nadir {

EventSeverity severity_of(OperatorSeverity severity) {
  if (severity <= OperatorSeverity::error) return EventSeverity::critical;
  return severity == OperatorSeverity::warning ? EventSeverity::warning : EventSeverity::info;
}

void FlightJournal::state(const ServiceEvent& event) {
  const ReasonText& reason = text_of(event.reason);
  events_.add(event.time_s, severity_of(reason.severity), "state", event.text);
  if (recorder_ == nullptr) return;
  recorder_->record(StateRecord{std::string(name_of(event.from)), std::string(name_of(event.to)),
                                std::string(reason.name) + ": " + event.text});
}

void FlightJournal::note(double time_s, EventSeverity severity, const std::string& kind, const std::string& text) {
  events_.add(time_s, severity, kind, text);
  if (recorder_ != nullptr) recorder_->record(HealthRecord{severity == EventSeverity::info, {}, {kind + ": " + text}});
}

}  // namespace nadir
