#include "trust/installed_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kLongestReportName = 64;
constexpr std::int64_t kMaxReportNumber = std::int64_t{1} << 53;

bool plain_name(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' ||
           c == '-';
  });
}

std::string read_plain_name(const JsonReader& in, const char* member) {
  std::string text = in.text(member, {.least = 1, .most = kLongestReportName});
  if (!plain_name(text)) in.refuse(member, "letters, digits, '.', '_' and '-'");
  return text;
}

// One spelling of each time, so that a report has one form.
UtcTime read_plain_time(const JsonReader& in, const char* member) {
  const UtcTime time = in.time(member);
  if (to_rfc3339(time) != in.text(member)) in.refuse(member, "a time like 2030-01-01T00:00:00Z");
  return time;
}

InstalledReport read_report(const JsonReader& in) {
  in.expect("schema", kInstalledSchema);
  InstalledReport report;
  report.airframe = read_plain_name(in, "airframe");
  if (report.airframe.starts_with('.')) in.refuse("airframe", "a name that does not begin with '.'");
  report.number = in.integer("number", 1, kMaxReportNumber);
  report.reported_at = read_plain_time(in, "reported_at");
  report.package = in.digest("package");
  report.series = in.text("series", {.least = 1, .most = kLongestReportName});
  report.sequence = in.integer("sequence", 0, kMaxReportNumber);
  report.root_version = in.integer("root_version", 1, kMaxReportNumber);
  report.verified_at = read_plain_time(in, "verified_at");
  report.accepted = in.choice("result", {"accepted", "refused"}) == "accepted";
  const JsonReader findings = in.array("findings", {.most = kMaxInstalledFindings});
  for (std::size_t i = 0; i < findings.size(); ++i) {
    report.findings.push_back(findings.text(i, {.least = 1, .most = kLongestReportName}));
    if (!plain_name(report.findings.back())) findings.refuse(i, "the code of a finding");
  }
  in.finish();
  return report;
}

}  // namespace

SignedInstalledReport sign_installed_report(const InstalledReport& report, const PrivateKey& key) {
  const json body{{"schema", kInstalledSchema},
                  {"airframe", report.airframe},
                  {"number", report.number},
                  {"reported_at", to_rfc3339(report.reported_at)},
                  {"package", report.package.hex()},
                  {"series", report.series},
                  {"sequence", report.sequence},
                  {"root_version", report.root_version},
                  {"verified_at", to_rfc3339(report.verified_at)},
                  {"result", report.accepted ? "accepted" : "refused"},
                  {"findings", report.findings}};
  SignedDocument document{body.dump(), {}};
  document.put(sign_payload(key, kInstalledPayloadType, as_bytes(document.signed_bytes)));
  return parse_installed_report(document.json(), "the new report");
}

SignedInstalledReport parse_installed_report(std::string_view text, std::string_view name) {
  if (text.size() > kMaxInstalledSize) {
    throw Error({.what = "cannot accept this report of an installed package",
                 .where = std::string(name),
                 .expected = fmt::format("at most {} bytes", kMaxInstalledSize),
                 .found = fmt::format("{} bytes", text.size())});
  }
  const json document = parse_json(text, name, {.max_depth = 4, .allow_floats = false});
  SignedDocument parts = split_signed_document(document, name);
  const JsonReader in(document,
                      {.name = std::string(name), .what = "cannot accept this report of an installed package"});
  return {read_report(in.object("signed")), std::move(parts)};
}

SignatureCheck check_installed_signature(const TrustRoot& root, const SignedInstalledReport& report,
                                         std::optional<UtcTime> at) {
  return check_tile_signatures(root, report.report.airframe, report.document.signatures, kInstalledPayloadType,
                               as_bytes(report.document.signed_bytes), at,
                               "report of airframe " + report.report.airframe);
}

std::int64_t next_report_number(const std::optional<std::string>& last, UtcTime now) {
  std::int64_t number = std::max<std::int64_t>(1, now.unix_s);
  if (!last) return number;
  try {
    const std::int64_t before = parse_installed_report(*last, kInstalledFile).report.number;
    return std::max(number, std::min(before, kMaxReportNumber - 1) + 1);
  } catch (const Error&) {
    return number;  // damaged: as if it were lost
  }
}

}  // namespace nadir
