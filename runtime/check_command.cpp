#include "check_command.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "framework/options.hpp"
#include "framework/output.hpp"
#include "package/open_package.hpp"
#include "trust/aircraft_state.hpp"
#include "trust/root.hpp"

namespace nadir {
namespace {

Figures readiness(const OpenPackage& package) {
  const Manifest& manifest = package.manifest();
  const ZoomRange zooms = package.imagery().zooms();
  return {
      {"ready", "yes"},
      {"mission", fmt::format("{} (series {}, sequence {})", manifest.mission_id, manifest.series, manifest.sequence)},
      {"valid until", to_rfc3339(manifest.expires)},
      {"map tiles", fmt::format("{}, zoom {} to {}", package.imagery().sidecars().size(), zooms.min, zooms.max)},
      {"terrain", package.terrain() != nullptr ? "elevation model" : "flat ground"},
      {"camera and autopilot", "not looked at: live service is not built in yet"}};
}

}  // namespace

std::string_view CheckCommand::details() const {
  return "Verifies the mission package as the aircraft does before take-off: signature, files, dates, airframe, "
         "sequence. With --state the aircraft remembers what it accepted and refuses anything older from then on.\n\n"
         "Live service (camera in, position out) is not built in yet; only --check is.\n\n"
         "Exit codes: 0 ready, 1 the package was refused, 2 it could not be checked.";
}

std::string_view CheckCommand::examples() const {
  return "nadird --package /data/valley --trust /etc/nadir/root.json --airframe mini-07 --state "
         "/var/lib/nadir/state.json "
         "--check";
}

void CheckCommand::setup(Options& options) {
  options.value("--package", package_, "PACKAGE", "the mission package").required();
  options.value("--trust", trust_, "FILE.json", "root of trust").required();
  options.value("--airframe", airframe_, "ID", "this aircraft; the package must be made for it");
  options.value("--state", state_, "FILE.json", "what this aircraft remembers; made when it is not there");
  options.value("--at", at_, "TIME", "check as if it were then; the present time by default");
  options.flag("--check", check_, "check the package, tell and end");
}

int CheckCommand::run(Context& context) {
  if (!check_) {
    throw UsageError({.what = "nadird cannot serve live yet",
                      .expected = "--check, which verifies the package and ends",
                      .fix = "fly recorded frames with `nadir replay`"});
  }
  const TrustRoot root = read_trusted_root(trust_);
  AircraftState state = state_ ? read_state(*state_) : AircraftState{};
  VerifyOptions options;
  options.root = &root;
  options.at = judging_time(at_, context.clock);
  options.airframe = airframe_;
  options.state = state_ ? &state : nullptr;
  const Opening opening = open_package(package_, options, context.progress);
  if (!opening.package) return report_findings(context.out, context.json, opening.findings);

  const Manifest& manifest = opening.package->manifest();
  if (state_) {
    state.accept(manifest.series, manifest.sequence, opening.root_version, options.at, opening.newer_roots);
    write_state(*state_, state);
  }
  if (context.json) {
    return report_findings(context.out, true, opening.findings,
                           {{"ready", true},
                            {"mission", manifest.mission_id},
                            {"series", manifest.series},
                            {"sequence", manifest.sequence},
                            {"expires", to_rfc3339(manifest.expires)},
                            {"tiles", opening.package->imagery().sidecars().size()},
                            {"live_service", false}});
  }
  if (!opening.findings.empty()) print_findings(context.err, opening.findings);
  print_figures(context.out, readiness(*opening.package));
  return kAccepted;
}

}  // namespace nadir
