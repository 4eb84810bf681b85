// The state machine of a flight: facts and the time in, state and events out. It reads no clock, starts nothing and
// tells nobody; the same facts at the same times give the same events.
//
// The conductor hands it every fact as it comes, calls it at least ten times a second without one, records each event,
// sends the operator's texts, and tells the autopilot what status() says: fix or no fix, how sure, and who should lead.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "service/camera_pace.hpp"
#include "service/service_facts.hpp"
#include "service/service_state.hpp"

namespace nadir {

struct ServiceConfig {
  double camera_interval_s = 1.0 / 3;  // between two pictures, until it has been measured
};

struct ServiceEvent {
  double time_s = 0;
  ServiceState from = ServiceState::boot;
  ServiceState to = ServiceState::boot;  // the same: something to know that changes no state
  ServiceReason reason = ServiceReason::started;
  std::string text;  // for the recorder: the explanation, with figures
};

enum class PositionLeader { gps, vision };

std::string_view name_of(PositionLeader leader);

struct ServiceStatus {
  ServiceState state = ServiceState::boot;
  ServiceReason reason = ServiceReason::started;  // of the state
  double since_s = 0;
  bool serves_fixes = false;                 // GPS_INPUT is sent at all: with the fix, or as "no fix"
  bool fix = false;                          // the position may be told
  SourceLabel source = SourceLabel::no_fix;  // under this label
  double sigma_m = 0;                        // one axis, kNoFixAccuracy_m without a fix; while blind it only grows
  PositionLeader leader = PositionLeader::gps;
  GpsVerdict gps = GpsVerdict::unknown;
  bool link_up = false;  // the autopilot has been heard lately, authentic
};

class ServiceMachine {
 public:
  explicit ServiceMachine(double now_s, const ServiceConfig& config = {});

  // now_s: monotonic; a time before the last one counts as the last one. Returns what changed, in order.
  std::vector<ServiceEvent> update(double now_s, std::span<const ServiceFact> facts = {});
  std::vector<ServiceEvent> update(double now_s, const ServiceFact& fact) { return update(now_s, std::span(&fact, 1)); }

  ServiceStatus status() const;  // as of the last update

 private:
  struct Step {
    ServiceState to;
    ServiceReason reason;
    std::string detail;
  };

  void learn(const PackageJudged& package);
  void learn(const AutopilotHeard& heard);
  void learn(const FrameArrived&);
  void learn(const EstimateMade& estimate);
  void learn(const EstimateRestored& restored);
  void learn(const GpsJudged& gps);

  void settle();  // what follows from the facts at this time
  void look_at_link();
  void look_at_vision();
  void choose_leader();
  void enter(const Step& step);
  void note(ServiceReason reason, const std::string& detail = {});

  std::optional<Step> next_step() const;
  std::optional<Step> step_from_search() const;
  std::optional<Step> step_from_fix() const;
  std::optional<Step> step_from_failsafe() const;
  std::optional<Step> blindness() const;  // why pictures carry nothing now, as the step to degraded
  std::optional<Step> loss() const;       // why the position may not be told, as the step to no_fix

  bool package_verified() const { return package_ && package_->verified; }
  bool tells_position() const { return state_ == ServiceState::normal || state_ == ServiceState::degraded; }
  bool position_held() const { return tells_position() || gps_ == GpsVerdict::trusted; }
  bool good_restored_position() const;
  bool steady_for(double seconds) const { return steady_since_s_ && now_s_ - *steady_since_s_ >= seconds; }
  double sigma_now_m() const;  // with its growth since the estimate

  CameraPace pace_;
  double now_s_;
  std::vector<ServiceEvent> events_;  // of the update that is going on

  ServiceState state_ = ServiceState::boot;
  ServiceReason reason_ = ServiceReason::started;
  double since_s_;

  std::optional<PackageJudged> package_;

  std::optional<double> heard_s_;  // the autopilot, authentic
  bool link_up_ = false;
  bool stranger_noted_ = false;

  std::optional<double> frame_s_;         // the newest picture
  std::optional<double> unanswered_s_;    // the oldest picture since the last estimate
  std::optional<double> estimate_s_;      // the newest estimate, or what was restored
  std::optional<double> seen_s_;          // the newest estimate that pictures carried
  std::optional<double> steady_since_s_;  // since when every estimate has been good
  SourceLabel source_ = SourceLabel::no_fix;
  bool has_position_ = false;
  bool restored_ = false;       // a saved position stands until it is lost
  bool anchored_ = false;       // since the position was lost
  bool ever_anchored_ = false;  // so that what comes is a return
  double sigma_m_ = 0;
  double growth_m_per_s_ = 0;  // of σ while blind
  double told_sigma_m_ = 0;    // while blind it never shrinks

  GpsVerdict gps_ = GpsVerdict::unknown;
  PositionLeader leader_ = PositionLeader::gps;
  std::optional<double> held_s_;  // since when the lack of a position counts: armed, or the last one, ours or GPS's
};

}  // namespace nadir
