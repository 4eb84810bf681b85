#include "commands/cache/shard_options.hpp"

#include <fmt/format.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "cli/nadir_version.hpp"
#include "cli/output.hpp"
#include "package_build/package_builder.hpp"
#include "package_build/work_shards.hpp"

namespace nadir {
namespace {

// What all of a package's results depend on: the program, and the files that are read.
std::string inputs_of(const Manifest& manifest) {
  std::string text = fmt::format("program: {}\n", kVersion);
  for (const std::string_view role : {kRoleMission, kRoleVectors}) {
    const Artifact* artifact = manifest.artifact(role);
    text += fmt::format("{}: {}\n", role, artifact == nullptr ? "none" : "sha256 " + artifact->sha256.hex());
  }
  if (const Artifact* imagery = manifest.artifact(kRoleImagery); imagery != nullptr && imagery->tiles) {
    text += fmt::format("imagery: tiles {}, sidecars {}\n", imagery->tiles->merkle_root.hex(),
                        imagery->tiles->sidecars_sha256.hex());
  }
  return text;
}

}  // namespace

std::optional<std::string> environment_variable(const char* name) {
  const char* text = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): before any thread
  return text == nullptr ? std::nullopt : std::optional<std::string>(text);
}

Mission read_signed_mission(const std::filesystem::path& package, const Manifest& manifest) {
  const Artifact* artifact = manifest.artifact(kRoleMission);
  if (artifact == nullptr) throw Error({.what = "the package has no mission", .where = package / kManifestFile});
  const Bytes bytes = read_artifact(package, *artifact, std::uint64_t{1} << 20);
  return parse_mission_or_throw(as_text(bytes), package / artifact->path);
}

void ShardOptions::setup(Options& options) {
  options.values(
      "--shards", folders_, "FOLDER",
      "with --shard: where this machine's part is put; without: where the parts of all are, instead of doing "
      "the work here");
  options
      .value("--shard", shard_, "I/N", "do part I of N, and nothing else (auto/N: as the scheduler numbers its tasks)")
      .needs("--shards");
}

void ShardOptions::check() const {
  if (!shard_ || folders_.size() == 1) return;
  throw UsageError(
      {.what = "a shard is put into one folder", .expected = "one --shards", .found = std::to_string(folders_.size())});
}

int ShardOptions::make(const SharedWork& work, const Manifest& manifest, const CheckedTiles& tiles, int threads,
                       Context& context) const {
  WorkShardRequest request;
  request.work = work_;
  request.inputs = inputs_of(manifest);
  request.number = parse_shard_number(*shard_, environment_variable);
  request.folder = folders_.front();
  request.threads = threads;
  request.check_inputs = [&] {
    const Findings findings = tiles.findings();
    if (findings.empty()) return;
    const Finding& first = findings.items().front();
    throw Error({.what = "a tile of the package is damaged",
                 .where = first.where,
                 .expected = first.expected,
                 .found = first.found,
                 .fix = "get the package again from its source"});
  };
  request.on_remark = [&](std::string_view remark) {
    if (!context.quiet) context.err << remark << '\n';
  };
  const WorkShardReport report = do_shard(work, request, context.progress);
  const auto [shard, shards] = request.number;
  if (context.json) {
    return report_findings(context.out, true, {},
                           {{"shard", shard},
                            {"shards", shards},
                            {"folder", report.folder.string()},
                            {"was_there", report.was_there},
                            {"tasks", report.tasks},
                            {"resumed", report.resumed}});
  }
  Figures figures{{"shard", fmt::format("{} of {}{}", shard, shards, report.was_there ? ", complete already" : "")},
                  {"folder", report.folder.string()},
                  {"tasks", std::to_string(report.tasks)}};
  if (report.resumed > 0) figures.emplace_back("resumed", fmt::format("{} tasks", report.resumed));
  print_figures(context.out, figures);
  return kAccepted;
}

void ShardOptions::finish(SharedWork& work, const std::filesystem::path& package, const Manifest& manifest, int threads,
                          Progress& progress) const {
  if (!take_all()) return do_alone(work, threads, progress);
  take_shards(work, work_, inputs_of(manifest), folders_,
              fmt::format("{} {} --shards {}", command_, package.string(), folders_.front().string()), progress);
}

}  // namespace nadir
