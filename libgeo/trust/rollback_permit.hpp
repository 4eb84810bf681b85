// A signed permit to go back from one package to an older one, when the newer one proves bad. It names the series, both
// numbers and a date, and may name one airframe, so that it allows nothing but what its makers meant:
//   {"signed": {"schema": "nadir.rollback-permit/1", "series", "from", "to", "expires"[, "airframe"]},
//    "signatures": […]}
// It is signed by those who may sign packages, with the same threshold.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"
#include "trust/root.hpp"
#include "trust/signed_document.hpp"

namespace nadir {

inline constexpr std::uint64_t kMaxPermitSize = std::uint64_t{1} << 16;
inline constexpr std::string_view kPermitSchema = "nadir.rollback-permit/1";
inline constexpr std::string_view kPermitPayloadType = "application/vnd.nadir.rollback-permit.v1+json";

struct RollbackPermit {
  std::string series;
  std::int64_t from = 0;                // the highest sequence that the aircraft has accepted
  std::int64_t to = 0;                  // the older one that it may accept again
  std::optional<std::string> airframe;  // none: every aircraft
  UtcTime expires;
};

struct SignedPermit {
  RollbackPermit permit;
  SignedDocument document;
};

SignedPermit sign_permit(const RollbackPermit& permit, const std::vector<const PrivateKey*>& keys);

// Checks the form alone; throws Error.
SignedPermit parse_permit(std::string_view json, std::string_view name);

// What somebody asks for.
struct RollbackRequest {
  std::string series;
  std::int64_t from = 0;
  std::int64_t to = 0;
  std::optional<std::string> airframe;
  UtcTime at;
};

// No findings when the permit allows exactly this. Otherwise permit.invalid, and those of its signatures.
Findings check_permit(const SignedPermit& permit, const TrustRoot& root, const RollbackRequest& request);

}  // namespace nadir
