#include "package_build/build_shards.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>
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
constexpr std::string_view kTileShards = "shard";  // their folders' name

void mount_objects(std::span<const PinnedFile> files) {
  for (const PinnedFile& file : files) {
    if (file.object) mount_object(*file.object);
  }
}

// A plan with what follows from it.
struct OpenPlan {
  OpenPlan(const fs::path& folder, ShardPlan plan_in, int threads)
      : plan(std::move(plan_in)),
        range(plan_range(plan.mission, plan.inputs)),
        tiles(plan.mission, plan.inputs, range, with_threads(plan.tiles, threads)) {
    for (const auto& files : plan.pins) mount_objects(files);
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
std::vector<PinnedLayer> layers_near(const OpenPlan& open, MetatileSpan part) {
  std::vector<PinnedLayer> layers;
  for (std::size_t i = 0; i < open.plan.inputs.size(); ++i) {
    for (std::size_t item = part.first; item < part.last; ++item) {
      const TileKey& key = open.tiles.metatiles[item];
      const int side = kTileSize << (open.range.zoom - key.z);
      const cv::Rect pixels(static_cast<int>(key.x) * side, static_cast<int>(key.y) * side, side, side);
      if (!lies_near(open.plan.inputs[i], open.range.zoom, pixels)) continue;
      layers.push_back({open.plan.inputs[i].path, open.plan.pins[i]});
      break;
    }
  }
  return layers;
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
  const auto journal = open_shard_journal(staging, configuration);
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

ShardReport build_shard(const ShardRequest& request, Progress& progress) {
  const OpenPlan open(request.plan, read_shard_plan(request.plan, request.program), request.threads);
  ShardReport report;
  report.shards = static_cast<int>(open.plan.shards.size());
  report.shard = parse_shard(request.shard, report.shards, request.variable);
  report.folder =
      (request.out.empty() ? request.plan : request.out) / shard_folder_name(kTileShards, report.shard, report.shards);
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

  const std::vector<PinnedLayer> layers = layers_near(open, part);
  for (const PinnedLayer& layer : layers) require_unchanged(layer, kPlanMade);
  StagingDirectory staging(report.folder, StagingDirectory::Leftovers::keep);
  staging.keep(true);  // whatever ends this run, the next one continues it
  if (staging.found_leftovers()) request.on_remark("continuing a shard that was interrupted");
  try {
    make_shard(open, staging.path(), report, progress);
    for (const PinnedLayer& layer : layers) require_unchanged(layer, kPlanMade);  // until now
    progress.advance(0);                                                          // the last point of interruption
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

TileSet merge_tiles(const OpenPlan& open, const std::vector<fs::path>& shards, const fs::path& file,
                    Progress& progress) {
  const SingleOpenCvThread one_thread;
  TileSetAssembler assembler(open.tiles, file);
  progress.begin("merging shards", open.tiles.metatiles.size(), "metatiles");
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

// What is there may be what a merge of this plan has made.
bool is_package_of(const ShardPlan& plan, const fs::path& package) {
  const fs::path mission = package / kMissionFile;
  return fs::is_regular_file(mission) && read_text_file(mission) == plan.mission_text;
}

fs::path beside(const fs::path& package) {
  const fs::path whole = fs::weakly_canonical(package);
  return whole.parent_path() / ("." + whole.filename().string() + ".again");
}

std::set<fs::path> files_in(const fs::path& folder) {
  std::set<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_directory()) files.insert(entry.path().lexically_relative(folder));
  }
  return files;
}

void require_same_files(const fs::path& made, const fs::path& package) {
  const std::set<fs::path> files = files_in(made);
  bool same = files == files_in(package);
  for (auto file = files.begin(); same && file != files.end(); ++file) {
    same = fs::is_regular_file(fs::symlink_status(package / *file)) &&
           fs::file_size(made / *file) == fs::file_size(package / *file) &&
           sha256_file(made / *file) == sha256_file(package / *file);
  }
  if (same) return;
  throw UsageError({.what = "there is a package already, and not the one of these shards",
                    .where = package.string(),
                    .expected = "none, or the one that this merge makes",
                    .found = "other files",
                    .fix = "choose another --out, or remove it"});
}

}  // namespace

PackageReport merge_shards(const MergeRequest& request, Progress& progress) {
  const OpenPlan open(request.plan_folder, request.plan, 1);
  const int shards = static_cast<int>(open.plan.shards.size());
  const std::vector<fs::path> folders =
      find_shards(kTileShards, shards, request.folders.empty() ? std::vector{request.plan_folder} : request.folders,
                  fmt::format("nadir cache build --plan {}", request.plan_folder.string()));
  for (int shard = 1; shard <= shards; ++shard) {  // before the work: is each of this plan?
    const ShardReader check(open, shard, folders[static_cast<std::size_t>(shard - 1)]);
  }

  PackageRequest package;
  package.mission = request.plan_folder / kShardPlanMission;
  package.tiles = open.tiles.options;
  package.key = request.key;
  package.roots = request.roots;
  package.now = request.now;
  for (const PinnedLayer& layer : open.plan.dem) {
    require_unchanged(layer, kPlanMade);
    mount_objects(layer.files);
    package.dem.push_back(layer.path);
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

  const bool exists = is_package_of(open.plan, request.out);
  StagingDirectory staging(exists ? beside(request.out) : request.out);
  PackageReport report = fill_package(
      staging.path(), package, build, [&](const fs::path& file) { return merge_tiles(open, folders, file, progress); },
      progress);
  if (!report.findings.has_errors()) {
    progress.advance();  // the last point of interruption
    if (exists) {
      require_same_files(staging.path(), request.out);
      report.was_there = true;
    } else {
      staging.commit();
    }
  }
  progress.end();
  return report;
}

}  // namespace nadir
