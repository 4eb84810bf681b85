#include "api/flight_view.hpp"

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

}  // namespace nadir
