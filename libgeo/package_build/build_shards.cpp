#include "package_build/build_shards.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

#include "base/files.hpp"
#include "package/mission_check.hpp"
#include "package_build/build_journal.hpp"
#include "raster/mosaic.hpp"
#include "raster/pinned_files.hpp"
#include "raster/single_opencv_thread.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPlanMade = "the plan was made";

// A plan with what follows from it.
struct OpenPlan {
  OpenPlan(const fs::path& folder, std::string_view program, int threads)
      : plan(read_shard_plan(folder, program)),
        range(plan_range(plan.mission, plan.inputs)),
        tiles(plan.mission, plan.inputs, range, with_threads(plan.tiles, threads)) {
    for (const auto& files : plan.pins) {
      for (const PinnedFile& file : files) {
        if (file.object) mount_object(*file.object);
      }
    }
    if (plan.shards.back().last == tiles.metatiles.size()) return;
    throw Error({.what = "this plan of a build does not fit its mission and imagery",
                 .where = (folder / kShardPlanFile).string(),
                 .expected = fmt::format("{} metatiles", tiles.metatiles.size()),
                 .found = std::to_string(plan.shards.back().last),
                 .fix = "make a new one: nadir cache plan-shards"});
  }
  OpenPlan(const OpenPlan&) = delete;
  OpenPlan& operator=(const OpenPlan&) = delete;

  static TileSetOptions with_threads(TileSetOptions options, int threads) {
    options.threads = threads;
    return options;
  }

  ShardPlan plan;
  TileRange range;
  TilePlan tiles;  // points into the others
};

// The files of the rasters that the metatiles read.
std::vector<PinnedFile> files_near(const OpenPlan& open, MetatileSpan part) {
  std::vector<PinnedFile> files;
  for (std::size_t i = 0; i < open.plan.inputs.size(); ++i) {
    for (std::size_t item = part.first; item < part.last; ++item) {
      const TileKey& key = open.tiles.metatiles[item];
      const int side = kTileSize << (open.range.zoom - key.z);
      const cv::Rect pixels(static_cast<int>(key.x) * side, static_cast<int>(key.y) * side, side, side);
      if (!lies_near(open.plan.inputs[i], open.range.zoom, pixels)) continue;
      files.insert(files.end(), open.plan.pins[i].begin(), open.plan.pins[i].end());
      break;
    }
  }
  return files;
}

[[noreturn]] void refuse_configuration(const fs::path& folder, std::string_view expected, std::string_view found) {
  const ConfigurationDifference difference = difference_of(expected, found);
  throw UsageError({.what = "this shard is of another plan",
                    .where = folder.string(),
                    .expected = difference.expected,
                    .found = difference.found,
                    .fix = "remove it, and build it by this plan: nadir cache build --plan PLAN --shard I/N"});
}

// A finished shard.
class ShardReader {
 public:
  ShardReader(const OpenPlan& open, int shard, const fs::path& folder)
      : open_(open),
        part_(open.plan.shards.at(static_cast<std::size_t>(shard - 1))),
        item_(part_.first),
        file_(folder / kJournalFile),
        journal_(file_) {
    const std::string expected = open.plan.description(shard);
    if (journal_.configuration() != expected) refuse_configuration(folder, expected, journal_.configuration());
  }

  // All of its metatiles in their order. Throws Error when there are fewer or more, or others.
  void read(const TakeMetatile& take) {
    while (const auto record = journal_.next()) {
      std::optional<Metatile> metatile = parse_metatile(*record);
      if (!metatile || item_ == part_.last || !fits(*metatile, open_.tiles.metatiles[item_])) {
        fail(fmt::format("what is not metatile {} of {}", item_ - part_.first + 1, part_.count()));
      }
      ++item_;
      if (!take(std::move(*metatile))) return;
    }
    if (item_ != part_.last) fail(std::to_string(item_ - part_.first));
  }

 private:
  bool fits(const Metatile& metatile, const TileKey& top) const {
    return std::all_of(metatile.tiles.begin(), metatile.tiles.end(), [&](const EncodedTile& tile) {
      const TileKey& key = tile.sidecar.key;
      return key.z >= top.z && key.z <= open_.range.zoom && key.x >> (key.z - top.z) == top.x &&
             key.y >> (key.z - top.z) == top.y;
    });
  }
  [[noreturn]] void fail(std::string found) const {
    throw Error({.what = "this shard is damaged",
                 .where = file_.string(),
                 .expected = fmt::format("{} metatiles", part_.count()),
                 .found = std::move(found),
                 .fix = "remove its folder and build it again"});
  }

  const OpenPlan& open_;
  MetatileSpan part_;
  std::size_t item_;
  fs::path file_;
  JournalReader journal_;
};

void count_tiles_of(const Metatile& metatile, ShardReport& report) {
  ++report.metatiles;
  report.tiles += metatile.tiles.size();
  for (const EncodedTile& tile : metatile.tiles) report.bytes += tile.bytes.size();
}

// Makes the shard's journal in its staging folder. Without errors in the findings it is complete.
void make_shard(const OpenPlan& open, const fs::path& staging, ShardReport& report, Progress& progress) {
  const MetatileSpan part = open.plan.shards[static_cast<std::size_t>(report.shard - 1)];
  const std::string configuration = open.plan.description(report.shard);
  std::optional<BuildJournal> journal;
  try {
    journal.emplace(staging / kJournalFile, configuration);
  } catch (const UsageError& error) {
    ErrorText text = error.text();
    text.what = "an interrupted build of this shard had another plan";
    text.fix = "remove " + staging.string();
    throw UsageError(text);
  }
  const std::uint64_t budget = static_cast<std::uint64_t>(open.plan.mission.budget_mb) * 1'000'000;
  progress.begin("making tiles", open.tiles.finest_tiles(part.first, part.last), "tiles");
  report.resumed = make_metatiles(
      open.tiles, part, *journal,
      [&](const Metatile& metatile) {
        count_tiles_of(metatile, report);
        return report.bytes <= budget;
      },
      progress);
  if (report.bytes > budget) report.findings = check_budget(open.plan.mission, report.bytes);
}

}  // namespace

std::string shard_folder_name(int shard, int shards) { return fmt::format("shard-{}-of-{}", shard, shards); }

ShardReport build_shard(const ShardRequest& request, Progress& progress) {
  const OpenPlan open(request.plan, request.program, request.threads);
  ShardReport report;
  report.shards = static_cast<int>(open.plan.shards.size());
  report.shard = parse_shard(request.shard, report.shards, request.variable);
  report.folder = (request.out.empty() ? request.plan : request.out) / shard_folder_name(report.shard, report.shards);
  const MetatileSpan part = open.plan.shards[static_cast<std::size_t>(report.shard - 1)];

  if (fs::exists(fs::symlink_status(report.folder))) {
    report.was_there = true;
    ShardReader shard(open, report.shard, report.folder);
    progress.begin("checking the shard", part.count(), "metatiles");
    shard.read([&](const Metatile& metatile) {
      count_tiles_of(metatile, report);
      progress.advance();
      return true;
    });
    progress.end();
    return report;
  }

  const std::vector<PinnedFile> files = files_near(open, part);
  require_unchanged(files, kPlanMade);
  StagingDirectory staging(report.folder, StagingDirectory::Leftovers::keep);
  staging.keep(true);  // whatever ends this run, the next one continues it
  if (staging.found_leftovers()) request.on_remark("continuing a shard that was interrupted");
  try {
    make_shard(open, staging.path(), report, progress);
    require_unchanged(files, kPlanMade);  // until now
    progress.advance(0);                  // the last point of interruption
    if (report.findings.has_errors()) {
      staging.keep(false);
    } else {
      staging.commit();
    }
    progress.end();
  } catch (const OutOfSpace& error) {
    ErrorText text = error.text();
    text.fix = "free space on this disk, then run the same command again: finished work is kept";
    throw OutOfSpace(text);
  }
  return report;
}

namespace {

std::string names_of(const std::vector<fs::path>& folders) {
  std::vector<std::string> names;
  for (const fs::path& folder : folders) names.push_back(folder.string());
  return fmt::format("{}", fmt::join(names, ", "));
}

// The folder of each shard, in order.
std::vector<fs::path> find_shards(const MergeRequest& request, int shards) {
  const std::vector<fs::path> folders = request.folders.empty() ? std::vector{request.plan} : request.folders;
  for (const fs::path& folder : folders) {
    if (fs::is_directory(folder)) continue;
    throw UsageError(
        {.what = "the folder of shards does not exist", .where = folder.string(), .fix = "check --shards"});
  }
  std::vector<fs::path> found;
  std::vector<std::string> missing;
  for (int shard = 1; shard <= shards; ++shard) {
    std::vector<fs::path> here;
    for (const fs::path& folder : folders) {
      const fs::path path = folder / shard_folder_name(shard, shards);
      if (fs::exists(fs::symlink_status(path))) here.push_back(path);
    }
    if (here.size() > 1 && !fs::equivalent(here[0], here[1])) {
      throw UsageError({.what = "a shard is there twice",
                        .where = fmt::format("shard {}/{}", shard, shards),
                        .expected = "one folder",
                        .found = fmt::format("{} and {}", here[0].string(), here[1].string()),
                        .fix = "remove one of them"});
    }
    if (here.empty()) {
      missing.push_back(std::to_string(shard));
    } else {
      found.push_back(here.front());
    }
  }
  if (missing.empty()) return found;
  constexpr std::size_t kNamed = 20;
  const std::string first = missing.front();
  std::string names = fmt::format(
      "{}", fmt::join(missing.begin(), missing.begin() + static_cast<std::ptrdiff_t>(std::min(kNamed, missing.size())),
                      ", "));
  if (missing.size() > kNamed) names += fmt::format(" and {} more", missing.size() - kNamed);
  throw UsageError({.what = missing.size() == 1 ? "a shard is missing" : "shards are missing",
                    .where = names_of(folders),
                    .expected = fmt::format("{} shards, shard-1-of-{} and so on", shards, shards),
                    .found = fmt::format("no {}", names),
                    .fix = fmt::format("build them: nadir cache build --plan {} --shard {}/{}", request.plan.string(),
                                       first, shards)});
}

PreparedBuild prepared_by(const OpenPlan& open, const PackageRequest& request) {
  PreparedBuild build;
  build.mission_text = open.plan.mission_text;
  build.mission = open.plan.mission;
  build.inputs = open.plan.inputs;
  build.range = open.range;
  build.at = open.plan.at.value_or(build.mission.created);
  build.of_inputs = check_stated_resolution(build.inputs);
  build.of_inputs.add(check_stated_licences(build.inputs));
  prepare_layers(request, build);
  return build;
}

TileSet merge_tiles(const OpenPlan& open, const std::vector<fs::path>& shards, const TilePlan& tiles,
                    const fs::path& file, Progress& progress) {
  const SingleOpenCvThread one_thread;
  TileSetAssembler assembler(tiles, file);
  progress.begin("merging shards", tiles.metatiles.size(), "metatiles");
  bool wanted = true;
  for (std::size_t i = 0; i < shards.size() && wanted; ++i) {
    ShardReader(open, static_cast<int>(i + 1), shards[i]).read([&](Metatile metatile) {
      wanted = assembler.add(std::move(metatile));
      progress.advance();
      return wanted;
    });
  }
  progress.end();
  return assembler.finish();
}

}  // namespace

PackageReport merge_shards(const MergeRequest& request, Progress& progress) {
  const OpenPlan open(request.plan, request.program, 1);
  const int shards = static_cast<int>(open.plan.shards.size());
  const std::vector<fs::path> folders = find_shards(request, shards);
  for (int shard = 1; shard <= shards; ++shard) {  // before the work: is each of this plan?
    const ShardReader check(open, shard, folders[static_cast<std::size_t>(shard - 1)]);
  }

  PackageRequest package;
  package.mission = request.plan / kShardPlanMission;
  package.tiles = open.tiles.options;
  package.key = request.key;
  package.roots = request.roots;
  package.now = request.now;
  if (open.plan.dem) {
    require_unchanged(open.plan.dem->files, kPlanMade);
    package.dem = open.plan.dem->path;
  }
  if (open.plan.vectors) {
    require_unchanged(open.plan.vectors->files, kPlanMade);
    package.vectors =
        VectorRequest{open.plan.vectors->path, open.plan.vectors_origin.attribution, open.plan.vectors_origin.licence};
  }
  const PreparedBuild build = prepared_by(open, package);
  if (build.rejected()) {
    PackageReport report;
    report.findings = build.of_inputs;
    return report;
  }

  StagingDirectory staging(request.out);
  PackageReport report = fill_package(
      staging.path(), package, build,
      [&](const TilePlan& plan, const fs::path& file) { return merge_tiles(open, folders, plan, file, progress); },
      progress);
  if (!report.findings.has_errors()) {
    progress.advance();  // the last point of interruption
    staging.commit();
  }
  progress.end();
  return report;
}

}  // namespace nadir
