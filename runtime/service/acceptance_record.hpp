// What was accepted for this flight, so that a restart in flight resumes it without repeating the checks.
//
// Accepting a package checks everything: signature, root, clock, expiry, freshness, what was accepted before. Resuming
// opens the accepted one by the digest of its manifest and checks only that it is complete. An acceptance holds
//
//   - within one boot of the computer, until the aircraft has landed;
//   - once the autopilot was armed, over reboots as well, until the aircraft has landed: the flag `airborne` is set
//   with
//     the first authenticated heartbeat that says "armed" and cleared after kLanded_s of authenticated heartbeats that
//     say "disarmed". An autopilot that is silent has not landed.
//
// acceptance.json in the state directory: a line of JSON ("nadir.acceptance/1") and its SHA-256. It holds the airframe
// file as well, and the package that was accepted before this one: in flight an older map is better than none.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "base/digest.hpp"
#include "base/time.hpp"

namespace nadir {

struct AcceptedPackage {
  Sha256 manifest;               // of manifest.json
  std::filesystem::path folder;  // where it was; any folder with this manifest will do
  std::string series;
  std::int64_t sequence = 0;
  UtcTime accepted_at;        // by which it was judged
  std::string airframe_file;  // its text, as it was accepted

  bool operator==(const AcceptedPackage&) const = default;
};

struct AcceptanceRecord {
  AcceptedPackage current;
  std::optional<AcceptedPackage> previous{};
  std::string boot_id{};  // of the acceptance; empty: the flight has ended
  bool airborne = false;  // armed, and not landed since

  // Whether it is to be resumed, in this boot.
  bool holds(std::string_view boot) const { return airborne || (!boot_id.empty() && boot_id == boot); }

  bool operator==(const AcceptanceRecord&) const = default;
};

// Another package was accepted: the current one becomes the previous, unless it is the same.
AcceptanceRecord accepted_next(const std::optional<AcceptanceRecord>& before, AcceptedPackage package,
                               std::string boot);

// Throws Error for what could not be read again.
std::string to_text(const AcceptanceRecord& record);

struct AcceptanceReading {
  std::optional<AcceptanceRecord> record;
  std::string rejection;  // why not; empty when nothing was accepted yet
};
AcceptanceReading parse_acceptance(std::string_view text);

// Follows the autopilot's heartbeats: has the aircraft taken off, has it landed? Times are monotonic seconds.
class FlightPhase {
 public:
  explicit FlightPhase(bool airborne) : airborne_(airborne) {}

  enum class Change { none, took_off, landed };
  // An authenticated heartbeat.
  Change on_heartbeat(double now_s, bool armed);

  bool airborne() const { return airborne_; }
  bool armed_ever() const { return armed_ever_; }  // in this run

 private:
  bool airborne_;
  bool armed_ever_ = false;
  std::optional<double> disarmed_since_s_;
};

}  // namespace nadir
