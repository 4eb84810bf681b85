// The FlightView that readers get, put together from what the parts say of themselves.
#pragma once

#include "api/flight_view.hpp"
#include "flight/autopilot_link.hpp"
#include "flight/flight_facts.hpp"
#include "recorder/recorder.hpp"
#include "service/service_machine.hpp"

namespace nadir {

class ViewBuilder {
 public:
  explicit ViewBuilder(std::string boot_id) { view_.boot_id = std::move(boot_id); }

  void package(const PackageView& package) { view_.package = package; }
  void localizer(const LocalizerEvent& spoke);
  void gps(const GpsJudged& judged);
  void status(const ServiceStatus& status, const std::string& reason);
  // What may be told is what is shown: while blind the fix that the autopilot gets, and nothing when it gets none.
  // Comes last, when all others have said what they know.
  void permit(const ServiceStatus& status, const std::optional<Fix>& told, double now_s);
  void frames(const MailboxCounts& counts, double now_s);
  void link(const AutopilotLink::State& state, bool connected, bool is_signed);
  void recorder(const Recorder* recorder, const std::string& trouble);

  FlightView view(double now_s, std::int64_t unix_us, const std::vector<FlightEvent>& events) const;

 private:
  FlightView view_;
  FlightTrail trail_;
  double rate_since_s_ = 0;
  std::uint64_t rate_from_ = 0;
};

}  // namespace nadir
