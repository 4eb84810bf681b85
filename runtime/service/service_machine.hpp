// The state machine of a flight: events and the time in, state transitions out. It reads no clock, starts nothing and
// notifies nobody; the same events at the same times give the same transitions.
//
// The conductor passes it every event as it comes, calls update() at least ten times a second without one, records the
// transitions, sends the operator's texts, and passes status() to the autopilot's link: fix or no fix, its accuracy,
// and which source should lead.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "service/onboard_event.hpp"
#include "service/position_usability.hpp"
#include "service/service_state.hpp"

namespace nadir {

// The frame interval of the camera, measured: so that a slow or irregular camera is not called silent between two
// frames, and a fast one is called silent at once.
//
// Of the last intervals, the median is the usual interval and the 90th percentile the usual latest arrival. Frames of a
// burst count as one; a gap in which the camera was silent is one interval among many. Times are monotonic seconds.
class FrameIntervalMonitor {
 public:
  // default_interval_s: until enough intervals are measured.
  explicit FrameIntervalMonitor(double default_interval_s) : default_interval_s_(default_interval_s) {}

  void on_frame(double time_s);

  // The camera is silent after so long without a frame: 400 ms; 1.2 intervals with slow cameras; more with irregular
  // ones, at most two median intervals: then a whole frame is missing.
  double silence_limit_s() const;

 private:
  static constexpr std::size_t kKept = 16;  // 5 s at 3 Hz

  double default_interval_s_;
  std::optional<double> last_s_;  // start of the current interval
  std::array<double, kKept> intervals_s_{};
  std::size_t measured_ = 0;
};

struct ServiceConfig {
  double camera_interval_s = 1.0 / 3;  // between two frames, until it is measured
  // Of the mission: which positions are usable.
  double integrity_risk = 1e-5;  // per look
  double alert_limit_m = 100;
  double time_to_alert_s = 3;
  ParameterCheck parameters = ParameterCheck::none_listed;  // at the start
};

enum class PositionLeader { gps, vision };

std::string_view name_of(PositionLeader leader);

struct ServiceStatus {
  ServiceState state = ServiceState::boot;
  ServiceReason reason = ServiceReason::started;  // of the state
  double since_s = 0;
  bool serves_fixes = false;                 // GPS_INPUT is sent: with the fix, or as "no fix"
  bool fix = false;                          // the position may be sent
  SourceLabel source = SourceLabel::no_fix;  // under this label
  double sigma_m = 0;                        // one axis, kNoFixAccuracy_m without a fix; while blind it only grows
  PositionLeader leader = PositionLeader::gps;
  GpsVerdict gps = GpsVerdict::unknown;
  bool link_up = false;             // authentic messages from the autopilot lately
  std::optional<double> frame_s{};  // when the latest frame arrived
  std::optional<double> hpl_m{};    // protection level; while blind it only grows. Nothing: none is known
  bool usable = false;              // it is within the alert limit, and no alert stands
};

class ServiceMachine {
 public:
  explicit ServiceMachine(double now_s, const ServiceConfig& config = {});

  // Both return the transitions, in order. now_s: monotonic; a time before the last one counts as the last one.
  // on_event() ignores events that are not its inputs.
  std::vector<StateTransition> on_event(double now_s, const OnboardEvent& event);
  std::vector<StateTransition> update(double now_s);

  ServiceStatus status() const;  // as of the last update

  // Why the state is as it is, for people, with durations as of the last update: they grow while it lasts.
  std::string reason_text() const;

 private:
  struct Step {
    ServiceState to;
    ServiceReason reason;
    std::string detail;
  };

  void on(const PackageVerified& package);
  void on(const AutopilotHeartbeat& heartbeat);
  void on(const FrameReceived&);
  void on(const LocalizedFrame& frame);
  void on(const MatchFailed&);
  void on(const EstimateRestored& restored);
  void on(const GpsAssessment& gps);
  void on(const ParametersCompared& parameters);

  void begin_update(double now_s);
  void apply_rules();  // what follows from the inputs at this time
  void check_link();
  void check_vision();
  void check_level();
  void check_usability();
  void choose_leader();
  void note_lead();
  void enter(const Step& step);
  void note(ServiceReason reason, const std::string& detail = {});

  std::optional<Step> next_step() const;
  std::optional<Step> step_from_search() const;
  std::optional<Step> step_from_fix() const;
  std::optional<Step> step_from_failsafe() const;
  std::optional<Step> blindness() const;  // why there is no visual position now, as the step to degraded
  std::optional<Step> loss() const;       // why the position must not be sent, as the step to no_fix

  bool package_verified() const { return package_ && package_->accepted; }
  bool provides_position() const { return state_ == ServiceState::normal || state_ == ServiceState::degraded; }
  bool has_any_position() const { return provides_position() || gps_ == GpsVerdict::trusted; }
  bool good_restored_position() const;
  bool steady_for(double seconds) const { return steady_since_s_ && now_s_ - *steady_since_s_ >= seconds; }
  double sigma_now_m() const;  // with its growth since the estimate
  std::optional<double> level_now_m() const;
  bool may_return() const { return anchored_ && !awaits_level_; }

  FrameIntervalMonitor frame_interval_;
  double now_s_;
  std::vector<StateTransition> transitions_;  // of the current update

  ServiceState state_ = ServiceState::boot;
  ServiceReason reason_ = ServiceReason::started;
  std::string detail_;  // of the reason, as of since_s_
  double since_s_;

  std::optional<PackageVerified> package_;

  std::optional<double> heartbeat_s_;  // the last authentic one
  bool link_up_ = false;
  LinkAuthentication authentication_ = LinkAuthentication::missing;  // of the link that is up
  bool unauthenticated_peer_noted_ = false;

  std::optional<double> frame_s_;         // the latest frame
  std::optional<double> unanswered_s_;    // the oldest frame since the last estimate
  std::optional<double> estimate_s_;      // the latest estimate, or the restored one
  std::optional<double> visual_s_;        // the latest visual estimate
  std::optional<double> steady_since_s_;  // since when every estimate is good
  int match_failures_ = 0;                // in a row
  SourceLabel source_ = SourceLabel::no_fix;
  bool has_position_ = false;
  bool restored_ = false;       // a saved position is in use
  bool anchored_ = false;       // since the position was lost
  bool ever_anchored_ = false;  // so that the next anchor is a return
  double sigma_m_ = 0;
  double growth_mps_ = 0;    // of σ while blind
  double sent_sigma_m_ = 0;  // never shrinks while blind

  const double level_sigmas_;  // of the mission's risk
  const double time_to_alert_s_;
  PositionUsability usability_;
  std::optional<double> hpl_m_;            // of the latest estimate with a position
  std::optional<double> level_known_s_;    // since when estimates have one …
  std::optional<double> level_unknown_s_;  // … or have none
  std::optional<double> provided_s_;       // since when there is a position of ours, without a break
  bool ever_provided_ = false;
  bool awaits_level_ = false;  // lost for want of one: it must be there for some time before the position is back

  GpsVerdict gps_ = GpsVerdict::unknown;
  PositionLeader leader_ = PositionLeader::gps;
  ParameterCheck parameters_;               // of the autopilot: whether it uses our position
  double vision_leads_s_ = 0;               // since when ours leads, while it does
  std::optional<ServiceReason> lead_note_;  // what the operator has read about it
  std::optional<double> position_s_;        // the last position, ours or of GPS, or armed: failsafe counts from here
};

}  // namespace nadir
