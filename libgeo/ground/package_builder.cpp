#include "ground/package_builder.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "ground/build_configuration.hpp"
#include "ground/build_journal.hpp"
#include "ground/terrain_builder.hpp"
#include "package/judge.hpp"
#include "package/judge_terrain.hpp"
#include "package/sign_package.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

std::vector<ImageryInput> open_inputs(const PackageRequest& request) {
  std::vector<ImageryInput> inputs;
  for (const fs::path& path : request.imagery) {
    const RasterSource source(path);
    inputs.push_back({path, read_imagery_facts(path, request.overrides), source.outline()});
  }
  return in_order(std::move(inputs), request.tiles.mosaic.order);
}

Mission parse_or_throw(std::string_view yaml, const fs::path& path) {
  MissionReading reading = parse_mission(yaml, path.string());
  if (reading.mission) return *reading.mission;
  const Finding& first = reading.findings.items().front();
  throw UsageError({.what = "the mission does not read",
                    .where = first.where,
                    .expected = first.expected,
                    .found = first.found,
                    .fix = first.fix.empty() ? "nadir mission check lists everything" : first.fix});
}

Findings judge_date(const Mission& mission, UtcTime at) {
  Findings findings;
  if (at >= mission.expires) {
    findings.add({.code = "package.expired",
                  .where = "mission.expires",
                  .expected = "later than " + to_rfc3339(at),
                  .found = to_rfc3339(mission.expires),
                  .fix = "plan the mission anew with a later date"});
  }
  return findings;
}

// Pixels of the world's map are counted in 32 bit while a build warps.
void check_zoom(const Mission& mission, const fs::path& path) {
  constexpr int kFinest = 22;
  if (mission.zoom.max <= kFinest) return;
  throw UsageError({.what = "tiles of this zoom are not built",
                    .where = path.string() + " (zoom.max)",
                    .expected = fmt::format("at most {}, which is 4 cm per pixel", kFinest),
                    .found = std::to_string(mission.zoom.max)});
}

std::uint64_t size_of(const fs::path& folder) {
  std::uint64_t size = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file() && entry.path().filename() != kJournalFile) size += entry.file_size();
  }
  return size;
}

void check_terrain_wanted(const Mission& mission, const PackageRequest& request) {
  if (!mission.terrain.flat || !request.dem) return;
  throw UsageError({.what = "the mission says that its ground is flat",
                    .where = request.mission.string() + " (terrain)",
                    .expected = "terrain: {mode: dem} when an elevation model is given",
                    .found = "mode: flat, and --dem " + request.dem->string(),
                    .fix = "write mode: dem, or leave --dem away"});
}

// Adds its findings; nothing with flat ground or without an elevation model.
std::optional<TerrainRaster> prepare_terrain(const Mission& mission, const PackageRequest& request,
                                             Findings& findings) {
  if (mission.terrain.flat) return std::nullopt;
  if (!request.dem) {
    findings.add({.code = "dem.gap",
                  .where = request.mission.string() + " (terrain)",
                  .expected = "an elevation model, because the mission says mode: dem",
                  .found = "none",
                  .fix = "give it with --dem FILE, or write terrain: {mode: flat, height_m: …}"});
    return std::nullopt;
  }
  TerrainRaster terrain = cut_terrain(*request.dem, mission);
  findings.add(judge_terrain(mission, terrain));
  return terrain;
}

// Before the work: sound as long as every pixel of the imagery is.
Findings judge_plan(const Mission& mission, const std::vector<ImageryInput>& inputs, const TileRange& range,
                    UtcTime at) {
  const std::vector<Sidecar> planned = plan_sidecars(mission, inputs, range);
  Findings findings = judge_date(mission, at);
  findings.add(judge_coverage(mission, planned));
  findings.add(judge_freshness(mission, planned, at));
  findings.add(judge_resolution(mission, planned));
  return findings;
}

// What is known once the plan is accepted.
struct Plan {
  const PackageRequest& request;
  const Mission& mission;
  const std::string& mission_text;
  const std::vector<ImageryInput>& inputs;
  const TileRange& range;
  const std::optional<TerrainRaster>& terrain;
  UtcTime at;
};

void remove_all_but_journal(const fs::path& folder) {
  std::vector<fs::path> rest;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().filename() != kJournalFile) rest.push_back(entry.path());
  }
  for (const fs::path& path : rest) fs::remove_all(path);
}

void tell_about_leftovers(const StagingDirectory& staging, const PackageRequest& request) {
  if (request.resume && !staging.found_leftovers()) request.tell("nothing to resume: building from the start");
  if (!request.resume && staging.found_leftovers()) {
    request.tell("what a killed build had left was discarded; with --resume the build would have gone on from there");
  }
}

// Everything of the package; adds its findings. Without refusal the folder is complete but for the journal in it.
void fill_package(const fs::path& folder, const Plan& plan, BuildJournal& journal, Progress& progress,
                  PackageReport& report) {
  const auto& [request, mission, mission_text, inputs, range, terrain, at] = plan;
  fs::create_directories(folder / fs::path(kImageryFile).parent_path());
  fs::create_directories(folder / fs::path(kMissionFile).parent_path());
  const TileSet set = build_tile_set(mission, inputs, range, request.tiles, folder / kImageryFile, journal, progress);
  if (set.over_budget) {
    report.findings = judge_budget(mission, set.tile_bytes);
    return;
  }
  write_file_atomic(folder / kMissionFile, mission_text);
  if (terrain) {
    fs::create_directories(folder / fs::path(kTerrainFile).parent_path());
    write_terrain(*terrain, folder / kTerrainFile);
    report.terrain = terrain->grid();
  }

  Manifest manifest = manifest_for(mission);
  manifest.artifacts.push_back(describe_file(folder, kImageryFile, kRoleImagery));
  manifest.artifacts.back().tiles = set.facts;
  manifest.artifacts.push_back(describe_file(folder, kMissionFile, kRoleMission));
  if (terrain) manifest.artifacts.push_back(describe_file(folder, kTerrainFile, kRoleTerrain));
  write_manifest(folder, manifest);
  if (request.key != nullptr) sign_package(folder, *request.key);

  report.resumed = set.resumed;
  report.tiles = set.facts.count;
  report.merkle_root = set.facts.merkle_root;
  report.bytes = size_of(folder);
  report.findings = judge_date(mission, at);
  report.findings.add(judge_tiles(mission, set.sidecars, report.bytes, at));
}

}  // namespace

PackageReport build_package(const PackageRequest& request, Progress& progress) {
  const std::string mission_text = read_text_file(request.mission, std::uint64_t{1} << 20);
  const Mission mission = parse_or_throw(mission_text, request.mission);
  check_zoom(mission, request.mission);
  check_terrain_wanted(mission, request);
  const std::vector<ImageryInput> inputs = open_inputs(request);
  const UtcTime at = request.at.value_or(mission.created);
  const TileRange range = plan_range(mission, inputs);

  PackageReport report;
  report.zoom = mission.zoom;
  report.findings = judge_plan(mission, inputs, range, at);
  const std::optional<TerrainRaster> terrain = prepare_terrain(mission, request, report.findings);
  if (report.findings.refuses()) return report;

  const std::string configuration = describe_build(request, mission_text, inputs);
  StagingDirectory staging(request.out,
                           request.resume ? StagingDirectory::Leftovers::keep : StagingDirectory::Leftovers::discard);
  try {
    staging.keep(staging.found_leftovers() && request.resume);  // until it is known that they are ours
    tell_about_leftovers(staging, request);
    BuildJournal journal(staging.path() / kJournalFile, configuration);
    remove_all_but_journal(staging.path());
    staging.keep(false);
    fill_package(staging.path(), {request, mission, mission_text, inputs, range, terrain, at}, journal, progress,
                 report);
    if (report.findings.refuses()) return report;
    fs::remove(staging.path() / kJournalFile);
    staging.commit();
  } catch (const OutOfSpace& error) {
    remove_all_but_journal(staging.path());
    staging.keep(true);
    ErrorText text = error.text();
    text.fix = "free space on this disk, then give the same command with --resume: what is done is kept";
    throw OutOfSpace(text);
  }
  return report;
}

}  // namespace nadir
