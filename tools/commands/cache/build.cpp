// `nadir cache build`: mission, imagery and elevation model to a signed package; or one shard of such a build.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/nadir_version.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/build_options.hpp"
#include "commands/cache/package_signer.hpp"
#include "commands/cache/shard_options.hpp"
#include "commands/commands.hpp"
#include "package_build/build_shards.hpp"

namespace nadir {
namespace {

class CacheBuildCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "build"; }
  std::string_view summary() const override { return "build and sign the map package of a mission"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  int run_shard(Context& context);

  BuildOptions build_options_;
  SigningOptions signing_;
  std::filesystem::path out_;
  bool resume_ = false;
  std::optional<std::filesystem::path> plan_;
  std::string shard_;
};

std::string_view CacheBuildCommand::details() const {
  return R"(Warps the imagery to map tiles at the mission's zooms, with overviews, masks and a sidecar per
tile, writes the manifest and signs it. What `cache verify` would reject is rejected here: gaps in
the area that the mission requires, imagery that is too old or too coarse, a package larger than
the budget. The findings are printed, the exit code is 1 and no output is left behind.

Capture time, GSD, provider and CE90 are read from the STAC Item beside each raster (map.tif +
map.json). Where rasters overlap, the first one named lies on top, or the newest or finest
(--mosaic). With --seam feather it fades into the next one over --feather-m metres.

8-bit imagery keeps its values. 16-bit and float imagery needs --stretch: one linear mapping from
MIN, black, to MAX, white, for all bands; the values used become part of each tile's source.

A mission with terrain: {mode: dem} needs an elevation model (--dem). It is cropped to the
mission's area plus a margin and becomes terrain/dem.tif of the package.

--vectors adds roads, water, woods and buildings, cut to the mission and simplified to the tiles'
resolution, as vectors/vectors.geojson: the pages draw them, and water informs `cache matchability`.

--carry-root adds newer roots of trust to the package, so that an aircraft that holds their
predecessor learns of new and revoked keys; each must be signed by its predecessor, the first one
by the root that --trust names.

The same inputs and the same key give the same bytes, whatever the number of threads. A build that
was killed, or ran out of disk space, continues with --resume and gives the same bytes as well.

With --plan and --shard it builds one part of a build that several machines share, and nothing of a
package yet: `cache plan-shards` makes the plan, `cache merge` the package. It needs no --mission,
no --imagery and no --out then. A shard that was killed is run again and continues; one that is
complete is only checked.)";
}

std::string_view CacheBuildCommand::examples() const {
  return R"(nadir cache build --mission mission.yaml --imagery map.tif --key planner.key.pem --out package
nadir cache build --mission mission.yaml --imagery map.tif --dem dem.tif --key planner.key.pem --out package
nadir cache build --mission mission.yaml --imagery map.tif --vectors region.osm.pbf --key planner.key.pem --out package
nadir cache build --mission mission.yaml --imagery new.tif --imagery old.tif --tile-format webp --out package
nadir cache build --mission mission.yaml --imagery map.tif --captured 2024-03-01 --gsd-m 0.3 --ce90-m 5 --provider survey --out package
nadir cache build --plan plan --shard 3/8
nadir cache build --plan plan --shard auto --threads 4)";
}

void CacheBuildCommand::setup(Options& options) {
  build_options_.setup(options);
  signing_.setup(options);
  options.value("--out", out_, "PACKAGE", "package folder to create; must not exist").required();
  options.flag("--resume", resume_, "resume a build that was killed, with the same inputs and options");
  options.value("--plan", plan_, "PLAN", "instead of all the above: build one shard of this plan (cache plan-shards)")
      .needs("--shard");
  options
      .value("--shard", shard_, "I/N",
             "which shard of the plan: 3/8, or auto in an array of Slurm, Kubernetes or AWS Batch; --out is then the "
             "folder that its folder is made in, the plan's by default")
      .needs("--plan");
  options.alternative("--plan", {"--shard", "--out", "--threads", "--json", "--quiet"});
}

// One shard: what the plan says, and nothing of the options above.
int CacheBuildCommand::run_shard(Context& context) {
  ShardRequest request;
  request.plan = *plan_;
  request.shard = shard_;
  request.out = out_;
  request.threads = build_options_.threads();
  request.program = kVersion;
  request.variable = environment_variable;
  if (!context.quiet)
    request.on_remark = [&context](std::string_view remark) { context.err << printable(remark) << '\n'; };
  const ShardReport report = build_shard(request, context.progress);
  if (report.findings.has_errors()) {
    if (!context.quiet) context.err << "rejected: nothing was written\n";
    return report_findings(context.out, context.json, report.findings);
  }
  if (context.json) {
    return report_findings(context.out, true, report.findings,
                           {{"shard", report.shard},
                            {"shards", report.shards},
                            {"folder", report.folder.string()},
                            {"was_there", report.was_there},
                            {"metatiles", report.metatiles},
                            {"tiles", report.tiles},
                            {"resumed_tiles", report.resumed},
                            {"bytes", report.bytes}});
  }
  print_figures(
      context.out,
      {{"shard", fmt::format("{} of {}{}", report.shard, report.shards, report.was_there ? ", complete already" : "")},
       {"folder", report.folder.string()},
       {"tiles", fmt::format("{} in {} metatiles", report.tiles, report.metatiles)},
       {"size", fmt::format("{:.1f} MB", static_cast<double>(report.bytes) / 1e6)}});
  return kAccepted;
}

int CacheBuildCommand::run(Context& context) {
  if (plan_) return run_shard(context);
  PackageRequest request = build_options_.request();
  const SigningOptions::Signing signing = signing_.read(evaluation_time(request.at, context.clock), context);
  request.key = signing.key ? &*signing.key : nullptr;
  request.roots = signing.roots;
  if (!request.at) request.now = context.clock.now();
  request.out = out_;
  request.resume = resume_;
  if (!context.quiet)
    request.on_remark = [&context](std::string_view remark) { context.err << printable(remark) << '\n'; };

  const PackageReport report = build_package(request, context.progress);
  if (report.findings.has_errors()) {
    if (!context.quiet) context.err << "rejected: nothing was written\n";
    return report_findings(context.out, context.json, report.findings);
  }
  print_package(context, out_, report, request.key);
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_build() { return std::make_unique<CacheBuildCommand>(); }

}  // namespace nadir
