// Builds the FlightView of the API from events and from the status of the parts.
#pragma once

#include "api/flight_view.hpp"
#include "flight/autopilot_link.hpp"
#include "package/mission.hpp"
#include "recorder/recorder.hpp"
#include "service/service_machine.hpp"

namespace nadir {

class ViewBuilder {
 public:
  explicit ViewBuilder(std::string boot_id, FlightTrail trail = FlightTrail()) : trail_(std::move(trail)) {
    view_.boot_id = std::move(boot_id);
  }

  void set_package(const PackageView& package) { view_.package = package; }
  void set_integrity(const IntegrityRequirement& integrity);
  void on_event(const LocalizedFrame& frame);
  void on_event(const GpsAssessment& gps);
  void on_event(const MatchFailed&) { ++view_.anchors.failed; }
  void on_event(const TileCorrupt&) { ++view_.package.corrupt_tiles; }
  void set_status(const ServiceStatus& status, const std::string& reason);
  void set_frames(const MailboxCounts& counts, double now_s);
  std::optional<double> anchor_age_s(double now_s) const {
    return view_.anchored_s ? std::optional(now_s - *view_.anchored_s) : std::nullopt;
  }
  void set_link(const AutopilotLink::State& state, bool connected, bool is_signed);
  void set_recorder(const Recorder* recorder, const std::string& error);
  // Shows what the autopilot gets: while blind the last fix, and nothing without one; the attitude is the autopilot's
  // own then, as long as it sends one. Call it last.
  void restrict_to_fix(const ServiceStatus& status, const std::optional<Fix>& last_fix, double now_s);

  FlightView view(double now_s, std::int64_t unix_us, const EventRing& events,
                  const EventRing& alarms = EventRing()) const;

 private:
  FlightView view_;
  FlightTrail trail_;
  std::optional<AircraftAttitude> attitude_;  // of the autopilot, at view_.link.last_message_s or before
  std::optional<double> attitude_s_;
  double rate_since_s_ = 0;
  std::uint64_t rate_from_ = 0;
};

}  // namespace nadir
