#include "package_build/package_builder.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "package_build/build_configuration.hpp"
#include "package_build/build_journal.hpp"
#include "raster/open_imagery.hpp"
#include "package_build/package_parts.hpp"
#include "package/mission_check.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

// Before the work: sound as long as every pixel of the imagery is.
Findings judge_plan(const Mission& mission, const std::vector<ImageryInput>& inputs, const TileRange& range,
                    UtcTime at) {
  const std::vector<Sidecar> planned = plan_sidecars(mission, inputs, range);
  Findings findings = judge_date(mission, at);
  findings.add(check_coverage(mission, planned));
  findings.add(check_freshness(mission, planned, at));
  findings.add(check_resolution(mission, planned));
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
  const fs::path tiles = folder / file_of(request.tiles.container);
  fs::create_directories(tiles.parent_path());
  const TileSet set = build_tile_set(mission, inputs, range, request.tiles, tiles, journal, progress);
  if (set.over_budget) {
    report.findings = check_budget(mission, set.tile_bytes);
    return;
  }
  progress.begin("completing the package", 3, "steps");
  complete_package(folder, {mission, mission_text, set.facts, terrain, request.roots, request.key}, progress);
  if (terrain) report.terrain = terrain->grid();
  report.resumed = set.resumed;
  report.tiles = set.facts.count;
  report.merkle_root = set.facts.merkle_root;
  report.bytes = package_size(folder);
  report.findings = judge_date(mission, at);
  report.findings.add(check_tile_requirements(mission, set.sidecars, report.bytes, at));
}

}  // namespace

PackageReport build_package(const PackageRequest& request, Progress& progress) {
  const std::string mission_text = read_text_file(request.mission, std::uint64_t{1} << 20);
  const Mission mission = parse_mission_or_throw(mission_text, request.mission);
  check_zoom(mission, request.mission);
  check_terrain_wanted(mission, request.mission, request.dem);
  const std::vector<ImageryInput> inputs =
      in_order(open_imagery(request.imagery, request.overrides, request.stretches), request.tiles.mosaic.order);
  const UtcTime at = request.at.value_or(mission.created);
  const TileRange range = plan_range(mission, inputs);

  PackageReport report;
  report.zoom = mission.zoom;
  report.findings = judge_plan(mission, inputs, range, at);
  const std::optional<TerrainRaster> terrain = prepare_terrain(mission, request.mission, request.dem, report.findings);
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
    if (report.findings.refuses()) {
      progress.end();
      return report;
    }
    fs::remove(staging.path() / kJournalFile);
    progress.advance();  // the last moment to be interrupted
    staging.commit();
    progress.end();
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
