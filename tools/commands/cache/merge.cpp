// `nadir cache merge`: the shards of a build to a signed package.
#include <fmt/format.h>

#include <filesystem>
#include <optional>
#include <ostream>
#include <vector>

#include "cli/command.hpp"
#include "cli/nadir_version.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/build_options.hpp"
#include "commands/cache/package_signer.hpp"
#include "commands/commands.hpp"
#include "package_build/build_shards.hpp"

namespace nadir {
namespace {

class CacheMergeCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "merge"; }
  std::string_view summary() const override { return "make a signed package of the shards of a build"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path plan_;
  std::vector<std::filesystem::path> folders_;
  SigningOptions signing_;
  std::filesystem::path out_;
};

std::string_view CacheMergeCommand::details() const {
  return R"(Takes every shard of a plan (`cache plan-shards`, `cache build --shard`), makes the overviews
above them, cuts terrain and vectors, checks the package as `cache build` does, and signs it. The
package is the same, byte for byte, as one machine would build from the same inputs, whatever the
number of shards.

A shard that is missing, there twice, damaged or of another plan ends it with exit code 2 before
anything is written under the final name. The shards are not changed. A merge that was killed or
ran out of disk space leaves no package; run it again. One that is repeated after its end makes the
package again beside the one that is there: exit code 0 when they are the same, else 2.)";
}

std::string_view CacheMergeCommand::examples() const {
  return R"(nadir cache merge --plan plan --key planner.key.pem --trust root.json --out package
nadir cache merge --plan plan --shards /data/node1 --shards /data/node2 --key planner.key.pem --out package)";
}

void CacheMergeCommand::setup(Options& options) {
  options.value("--plan", plan_, "PLAN", "folder of the plan").required();
  options.values("--shards", folders_, "FOLDER", "folders that the shards' folders lie in; default: the plan's");
  signing_.setup(options);
  options.value("--out", out_, "PACKAGE", "package folder to create").required();
}

int CacheMergeCommand::run(Context& context) {
  MergeRequest request;
  request.plan_folder = plan_;
  request.plan = read_shard_plan(plan_, kVersion);
  const std::optional<UtcTime> at = request.plan.at;
  const SigningOptions::Signing signing = signing_.read(evaluation_time(at, context.clock), context);
  request.folders = folders_;
  request.key = signing.key ? &*signing.key : nullptr;
  request.roots = signing.roots;
  if (!at) request.now = context.clock.now();
  request.out = out_;
  const PackageReport report = merge_shards(request, context.progress);
  if (report.findings.has_errors()) {
    if (!context.quiet) context.err << "rejected: nothing was written\n";
    return report_findings(context.out, context.json, report.findings);
  }
  if (report.was_there && !context.quiet) context.err << "the package was there already: the same, byte for byte\n";
  print_package(context, out_, report, request.key);
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_cache_merge() { return std::make_unique<CacheMergeCommand>(); }

}  // namespace nadir
