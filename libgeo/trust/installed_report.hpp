// The package that an aircraft has installed, reported by the aircraft itself: otherwise only what was sent out is
// known. A small document that nadird signs with the airframe's tile key once it has accepted a package (Uptane's
// version report):
//   {"signed": {"schema": "nadir.installed/1", "airframe", "number", "reported_at", "package", "series", "sequence",
//    "root_version", "verified_at", "result", "findings"}, "signatures": [{"keyid", "sig"}]}
// Reports of one airframe are numbered upwards, so that an old one cannot be passed off as new: the aircraft's clock
// may be wrong, its count is not. docs/formats/installed.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/digest.hpp"
#include "base/time.hpp"
#include "trust/signatures.hpp"
#include "trust/signed_document.hpp"

namespace nadir {

inline constexpr std::string_view kInstalledFile = "installed.json";
inline constexpr std::string_view kInstalledSchema = "nadir.installed/1";
inline constexpr std::string_view kInstalledPayloadType = "application/vnd.nadir.installed.v1+json";
inline constexpr std::uint64_t kMaxInstalledSize = std::uint64_t{1} << 14;  // bytes
inline constexpr std::size_t kMaxInstalledFindings = 32;

struct InstalledReport {
  std::string airframe;     // 1 to 64 of A-Z a-z 0-9 . _ -, not beginning with '.'
  std::int64_t number = 0;  // above that of every earlier report of the airframe
  UtcTime reported_at;      // by the aircraft's clock, as verified_at
  Sha256 package;           // of manifest.json
  std::string series;
  std::int64_t sequence = 0;
  std::int64_t root_version = 0;  // that the package was verified by
  UtcTime verified_at;
  bool accepted = true;                 // "accepted", else "refused"
  std::vector<std::string> findings{};  // codes, warnings included
};

struct SignedInstalledReport {
  InstalledReport report;
  SignedDocument document;

  std::string json() const { return document.json(); }
};

// Throws Error for what parse_installed_report() would refuse.
SignedInstalledReport sign_installed_report(const InstalledReport& report, const PrivateKey& key);

// Form only; throws Error, naming the member.
SignedInstalledReport parse_installed_report(std::string_view text, std::string_view name);

// Signed by a tile key that the root gives to the airframe that it names? at: nullopt skips the expiry of keys.
SignatureCheck check_installed_signature(const TrustRoot& root, const SignedInstalledReport& report,
                                         std::optional<UtcTime> at);

// The number of the report after `last`, the text of the aircraft's last one: one more, and not below the clock's
// seconds, so that an aircraft that lost its memory goes on above what it said before.
std::int64_t next_report_number(const std::optional<std::string>& last, UtcTime now);

}  // namespace nadir
