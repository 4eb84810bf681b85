// A signed permit to forget a remembered time. An aircraft accepts no clock earlier than the time of its last
// acceptance (aircraft_state.hpp); when that time was wrong, every right clock is refused. The permit names exactly the
// time that the aircraft remembers and the one that takes its place, so that it works once and nowhere else:
//   {"signed": {"schema": "nadir.time-permit/1", "remembered", "instead", "expires"[, "airframe"]},
//    "signatures": […]}
// It is signed by those who may sign packages, with the same threshold.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"
#include "trust/root.hpp"
#include "trust/signed_document.hpp"

namespace nadir {

inline constexpr std::string_view kTimePermitSchema = "nadir.time-permit/1";
inline constexpr std::string_view kTimePermitPayloadType = "application/vnd.nadir.time-permit.v1+json";

struct TimePermit {
  UtcTime remembered;                   // exactly what the aircraft remembers
  UtcTime instead;                      // earlier
  std::optional<std::string> airframe;  // none: every aircraft
  UtcTime expires;
};

struct SignedTimePermit {
  TimePermit permit;
  SignedDocument document;
};

SignedTimePermit sign_time_permit(const TimePermit& permit, const std::vector<const PrivateKey*>& keys);

// Checks the form alone; throws Error.
SignedTimePermit parse_time_permit(std::string_view json, std::string_view name);

// What somebody asks for.
struct TimeResetRequest {
  UtcTime remembered;
  std::optional<std::string> airframe;
  UtcTime at;
};

// No findings when the permit allows exactly this. Otherwise permit.invalid, and those of its signatures.
Findings check_time_permit(const SignedTimePermit& permit, const TrustRoot& root, const TimeResetRequest& request);

}  // namespace nadir
