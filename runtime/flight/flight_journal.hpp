// Where events are reported: the recorder, the event list of the API, and the operator.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>

#include "api/flight_view.hpp"
#include "mavlink/messages.hpp"
#include "recorder/recorder.hpp"
#include "service/onboard_event.hpp"
#include "service/service_rules.hpp"

namespace nadir {

EventSeverity severity_of(OperatorSeverity severity);

// Tells a recorded note that was critical from a warning: both are unhealthy.
inline constexpr const char* kAlarmMeasure = "alarm";

class FlightJournal {
 public:
  // recorder: may be null, must outlive this.
  explicit FlightJournal(Recorder* recorder) : recorder_(recorder) {}

  void use(Recorder* recorder) { recorder_ = recorder; }  // one that could not be started before

  // Events that are frequent or that only cause others leave no entry.
  void on_event(double time_s, const OnboardEvent& event);
  void note(double time_s, EventSeverity severity, const std::string& kind, const std::string& text);

  const EventRing& events() const { return events_; }
  const EventRing& alarms() const { return alarms_; }  // the critical ones, which no other event displaces

 private:
  void on(double time_s, const StateTransition& transition);
  void on(double time_s, const CameraFailed& failed);
  void on(double time_s, const PartReported& reported);
  void on(double time_s, const TileCorrupt& tile);
  void on(double time_s, const MatchFailed& failed);
  void on(double time_s, const LocalizedFrame& frame);
  void on(double time_s, const FixJumped& jumped);
  void on(double time_s, const PositionHinted& hint);
  void on(double time_s, const HintRefused& refused);
  void on(double time_s, const LinkRivalSeen& rival);
  void on(double time_s, const ParameterChanged& changed);
  void on(double time_s, const ParametersMissing& missing);
  void on(double time_s, const AutopilotVersionChanged& changed);

  void add(double time_s, EventSeverity severity, const std::string& kind, const std::string& text);

  Recorder* recorder_;
  EventRing events_{100, kRepeatWindow_s}, alarms_{50, kRepeatWindow_s};
  bool match_failed_ = false;  // and none has succeeded since
};

std::string text_of(const FixJumped& jumped);
std::string text_of(const PartReported& reported);    // without the part's name
std::string on_one_line(const std::string& failure);  // the text of an Error

// The operator's texts, until an autopilot is connected: before the first heartbeat and while the link is lost the
// latest texts wait, oldest first, however long. For one thread.
class OperatorTexts {
 public:
  using Listener = std::function<void(TextSeverity severity, const std::string& text)>;

  explicit OperatorTexts(std::size_t capacity = 12) : capacity_(capacity) {}

  // Ignores an empty text. When the queue is full, the oldest text is dropped.
  void add(TextSeverity severity, std::string text);

  // Delivers all of them.
  void deliver(const Listener& listener);

  std::size_t pending() const { return texts_.size(); }
  std::uint64_t dropped() const { return dropped_; }

 private:
  struct Text {
    TextSeverity severity;
    std::string text;
  };
  std::size_t capacity_;
  std::deque<Text> texts_;
  std::uint64_t dropped_ = 0;
};

}  // namespace nadir
