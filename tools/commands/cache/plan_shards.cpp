// `nadir cache plan-shards`: checks a build and splits it among machines.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>

#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/build_options.hpp"
#include "commands/commands.hpp"
#include "package_build/shard_plan.hpp"

namespace nadir {
namespace {

class CachePlanShardsCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "plan-shards"; }
  std::string_view summary() const override { return "plan a build that several machines share"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  BuildOptions build_options_;
  int shards_ = 0;
  std::filesystem::path out_;
};

std::string_view CachePlanShardsCommand::details() const {
  return R"(Takes what `cache build` takes, checks what a build checks before it reads pixels (gaps, age,
resolution, terrain, dates), hashes every input once and writes the plan: a folder with the mission
and plan.json. On rejection the findings are printed, the exit code is 1 and no plan is left behind.

`cache build --plan PLAN --shard I/N` then builds each shard, on any machine that reaches the inputs
under the same paths, in any order; `cache merge --plan PLAN` makes the package, which is the same,
byte for byte, as one machine would build. All must run the same version of nadir.)";
}

std::string_view CachePlanShardsCommand::examples() const {
  return R"(nadir cache plan-shards --mission mission.yaml --imagery map.tif --dem dem.tif --shards 8 --out plan
nadir cache build --plan plan --shard 3/8
nadir cache merge --plan plan --key planner.key.pem --out package)";
}

void CachePlanShardsCommand::setup(Options& options) {
  build_options_.setup(options);
  options.value("--shards", shards_, "N", "number of parts, with about as many tiles each")
      .required()
      .between(1, kMaxShards);
  options.value("--out", out_, "PLAN", "folder to create; must not exist").required();
}

int CachePlanShardsCommand::run(Context& context) {
  PackageRequest request = build_options_.request();
  if (!request.at) request.now = context.clock.now();
  const ShardPlanReport report = plan_shards(request, shards_, out_, context.progress);
  if (report.findings.has_errors()) {
    if (!context.quiet) context.err << "rejected: nothing was written\n";
    return report_findings(context.out, context.json, report.findings);
  }
  if (context.json) {
    return report_findings(context.out, true, report.findings,
                           {{"plan", out_.string()},
                            {"shards", shards_},
                            {"metatiles", report.metatiles},
                            {"tiles", report.tiles},
                            {"most_finest_tiles", report.most_tiles},
                            {"imagery_bytes", report.imagery_bytes}});
  }
  if (!report.findings.empty()) print_findings(context.out, report.findings);
  print_figures(context.out,
                {{"plan", out_.string()},
                 {"shards", fmt::format("{}, of at most {} tiles of the finest zoom", shards_, report.most_tiles)},
                 {"tiles", fmt::format("at most {} of all zooms", report.tiles)},
                 {"imagery", fmt::format("{:.1f} MB", static_cast<double>(report.imagery_bytes) / 1e6)},
                 {"next", fmt::format("nadir cache build --plan {0} --shard 1/{1} to {1}/{1}, then nadir cache merge",
                                      out_.string(), shards_)}});
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_plan_shards() { return std::make_unique<CachePlanShardsCommand>(); }

}  // namespace nadir
