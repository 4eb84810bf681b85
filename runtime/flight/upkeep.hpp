// The thread on which disks may be slow. Twice a second, and at once when there is an estimate to save, it does what
// the flight needs done and never waits for:
//
//   part                         work                                   while it fails
//   state directory              flight.json, acceptance.json           a restart resumes from what was saved last
//   recorder, API, tiles         starts what could not be started       optional_parts.hpp
//   memory of packages           what this aircraft accepted, once      an older package is not recognized as older
//   signing time, once a second  when the link last signed              after a restart peers may reject our frames
//   machine, every 5 s           measures its health for the recorder   -
//   package, when there is none  asks whether one can be opened now     no position
//
// Nothing of it ends the flight. A part that fails is reported (PartReported), tried again after 1, 2, 4 … 30 s, and
// reported when it works; a package that can be opened is reported (PackageRestored).
//
// What is to be saved waits in mailboxes of one: a newer one replaces the older. What could not be written waits on the
// upkeep thread, and is tried once more at the end of the flight, whenever it would be due.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>

#include "flight/autopilot_link.hpp"
#include "flight/optional_parts.hpp"
#include "service/acceptance_record.hpp"
#include "service/clock.hpp"
#include "service/machine_health.hpp"
#include "service/mailbox.hpp"
#include "service/onboard_event.hpp"
#include "service/retried_part.hpp"
#include "service/saved_flight.hpp"
#include "service/service_rules.hpp"

namespace nadir {

struct UpkeepSetup {
  std::filesystem::path state;                    // folder
  std::optional<AcceptanceRecord> acceptance{};   // saved first; nullopt: nothing is kept
  std::function<void()> write_memory = nullptr;   // of accepted packages; throws, and is tried again
  std::function<bool()> can_be_opened = nullptr;  // a package, now that there is none
};

class Upkeep {
 public:
  using Publish = std::function<void(OnboardEvent)>;  // from the thread that does the work

  // parts, clock and what `publish` uses must outlive this.
  Upkeep(UpkeepSetup setup, OptionalParts& parts, const FlightClock& clock, Publish publish);
  Upkeep(const Upkeep&) = delete;
  Upkeep& operator=(const Upkeep&) = delete;

  // Every part that is due. Before start(), on the caller's thread: what works is there before the first frame.
  void tend();

  // From now on the upkeep thread does it, and saves the link's signing state. link: must outlive finish().
  void start(AutopilotLink& link);

  // From any thread.
  void save(SavedFlight flight) { flights_.put(std::move(flight)); }
  void save(AcceptanceRecord acceptance) { acceptances_.put(std::move(acceptance)); }

  // The clean end, after the link has stopped: ends the thread, and writes what waits and what the link signed last.
  // Why that could not be written; empty: it was.
  std::string finish();

 private:
  void run(const std::stop_token& stop);
  void save_state();
  void ask_for_package(double now_s);

  const FlightClock& clock_;
  const Publish publish_;
  OptionalParts& parts_;
  AutopilotLink* link_ = nullptr;  // with start()
  LatestMailbox<SavedFlight> flights_;
  LatestMailbox<AcceptanceRecord> acceptances_;

  // Of the thread that does the work.
  StateDirectory state_;
  bool state_prepared_ = false;
  struct Unsaved {
    std::optional<SavedFlight> flight;
    std::optional<AcceptanceRecord> acceptance;
  } unsaved_;
  struct Retries {
    RetriedPart state{"state directory"}, memory{"memory of packages"}, signing{"signing time"};
  } retries_;
  std::function<void()> write_memory_;  // null: written
  struct PackageQuestion {
    std::function<bool()> can_be_opened;  // null: not to be asked
    double next_s = 0, pause_s = kFirstRetry_s;
  } package_;
  MachineHealth health_;

  std::jthread thread_;  // last: it uses everything above
};

}  // namespace nadir
