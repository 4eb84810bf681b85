// Builds the FlightView of the API from events and from the status of the parts.
#pragma once

#include "api/flight_view.hpp"
#include "flight/autopilot_link.hpp"
#include "recorder/recorder.hpp"
#include "service/service_machine.hpp"

namespace nadir {

class ViewBuilder {
 public:
  explicit ViewBuilder(std::string boot_id) { view_.boot_id = std::move(boot_id); }

  void set_package(const PackageView& package) { view_.package = package; }
  void on_event(const LocalizedFrame& frame);
  void on_event(const GpsAssessment& gps);
  void set_status(const ServiceStatus& status, const std::string& reason);
  void set_frames(const MailboxCounts& counts, double now_s);
  void set_link(const AutopilotLink::State& state, bool connected, bool is_signed);
  void set_recorder(const Recorder* recorder, const std::string& error);
  // Shows what the autopilot gets: while blind the last fix, and nothing without one. Call it last.
  void restrict_to_fix(const ServiceStatus& status, const std::optional<Fix>& last_fix, double now_s);

  FlightView view(double now_s, std::int64_t unix_us, const std::vector<FlightEvent>& events) const;

 private:
  FlightView view_;
  FlightTrail trail_;
  double rate_since_s_ = 0;
  std::uint64_t rate_from_ = 0;
};

}  // namespace nadir
