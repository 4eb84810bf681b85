#include "check_command.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "framework/options.hpp"
#include "framework/output.hpp"
#include "package/open_package.hpp"
#include "vision/place_index_check.hpp"

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
         "sequence. With --state the aircraft remembers what it accepted and refuses anything older from "
         "then on,\nbut for a step back that --permit allows. A damaged state or permit refuses the package.\n\n"
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
  request_.setup(options);
  options.flag("--check", check_, "check the package, tell and end");
}

int CheckCommand::run(Context& context) {
  if (!check_) {
    throw UsageError({.what = "nadird cannot serve live yet",
                      .expected = "--check, which verifies the package and ends",
                      .fix = "fly recorded frames with `nadir replay`"});
  }
  const VerifyOptions options = request_.open(context.clock);
  Opening opening = open_package(package_, options, context.progress);
  verify_place_index(package_, options.depth, context.progress, opening);
  opening.findings.add(request_.findings());
  if (!opening.package || opening.findings.refuses()) {
    return report_findings(context.out, context.json, opening.findings);
  }

  const Manifest& manifest = opening.package->manifest();
  request_.remember(manifest, opening.root_version, opening.newer_roots);
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
