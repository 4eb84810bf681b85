#include "package_build/package_builder.hpp"

#include <fmt/format.h>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "package/mission_check.hpp"
#include "package/package_writer.hpp"
#include "package_build/build_journal.hpp"
#include "package_build/pinned_file.hpp"
#include "package_build/terrain_builder.hpp"
#include "raster/imagery_input.hpp"
#include "vision/place_index.hpp"

namespace nadir {
namespace fs = std::filesystem;

Mission parse_mission_or_throw(std::string_view yaml, const fs::path& path) {
  MissionReading reading = parse_mission(yaml, path.string());
  if (reading.mission) return *reading.mission;
  const Finding& first = reading.findings.items().front();
  throw UsageError({.what = "the mission is invalid",
                    .where = first.where,
                    .expected = first.expected,
                    .found = first.found,
                    .fix = first.fix.empty() ? "`nadir mission check` lists all errors" : first.fix});
}

void check_zoom(const Mission& mission, const fs::path& path) {
  constexpr int kFinest = 22;
  if (mission.zoom.max <= kFinest) return;
  throw UsageError({.what = "this zoom is not supported",
                    .where = path.string() + " (zoom.max)",
                    .expected = fmt::format("at most {}, which is 4 cm per pixel", kFinest),
                    .found = std::to_string(mission.zoom.max)});
}

void check_terrain_wanted(const Mission& mission, const fs::path& mission_file, std::span<const fs::path> dem) {
  if (!mission.terrain.flat || dem.empty()) return;
  throw UsageError({.what = "the mission states flat terrain",
                    .where = mission_file.string() + " (terrain)",
                    .expected = "terrain: {mode: dem} when an elevation model is given",
                    .found = "mode: flat and --dem " + dem.front().string(),
                    .fix = "set mode: dem, or omit --dem"});
}

std::optional<TerrainRaster> prepare_terrain(const Mission& mission, const fs::path& mission_file,
                                             std::span<const fs::path> dem, Findings& findings) {
  if (mission.terrain.flat) return std::nullopt;
  if (dem.empty()) {
    findings.add({.code = "dem.gap",
                  .where = mission_file.string() + " (terrain)",
                  .expected = "an elevation model, because the mission has mode: dem",
                  .found = "none",
                  .fix = "pass --dem FILE, or set terrain: {mode: flat, height_m: …}"});
    return std::nullopt;
  }
  TerrainRaster terrain = cut_terrain(dem, mission);
  findings.add(check_terrain(mission, terrain));
  return terrain;
}

void complete_package(const fs::path& folder, const PackageParts& parts, Progress& progress) {
  fs::create_directories(folder / fs::path(kMissionFile).parent_path());
  write_file_atomic(folder / kMissionFile, parts.mission_text);
  if (parts.terrain) {
    fs::create_directories(folder / fs::path(kTerrainFile).parent_path());
    write_terrain(*parts.terrain, folder / kTerrainFile);
  }
  if (parts.vectors != nullptr) {
    fs::create_directories(folder / fs::path(kVectorsFile).parent_path());
    write_file_atomic(folder / kVectorsFile, parts.vectors->text);
  }
  add_package_roots(folder, parts.roots);
  progress.advance();

  Manifest manifest = manifest_for(parts.mission);
  const bool cog = fs::exists(folder / kCogFile);
  manifest.artifacts.push_back(describe_file(folder, cog ? kCogFile : kImageryFile, kRoleImagery));
  manifest.artifacts.back().tiles = parts.tiles;
  if (cog) manifest.artifacts.push_back(describe_file(folder, kSidecarFile, kRoleSidecars));
  manifest.artifacts.push_back(describe_file(folder, kMissionFile, kRoleMission));
  if (parts.terrain) manifest.artifacts.push_back(describe_file(folder, kTerrainFile, kRoleTerrain));
  if (parts.vectors != nullptr) {
    manifest.artifacts.push_back(describe_file(folder, kVectorsFile, kRoleVectors));
    manifest.artifacts.back().vectors = parts.vectors->facts;
  }
  if (parts.index != nullptr) {
    for (Artifact& artifact : write_place_index(folder, *parts.index))
      manifest.artifacts.push_back(std::move(artifact));
  }
  write_manifest(folder, manifest);
  if (parts.key != nullptr) sign_package(folder, *parts.key);
  progress.advance();
}

std::vector<Artifact> write_place_index(const fs::path& folder, const PlaceIndex& index) {
  fs::create_directories((folder / kPlaceIndexFile).parent_path());
  write_file_atomic(folder / kPlaceIndexFile, index.vectors().file());
  write_file_atomic(folder / kPlaceTableFile, place_table_json(index.table()));
  return {describe_file(folder, kPlaceIndexFile, kRolePlaceIndex),
          describe_file(folder, kPlaceTableFile, kRolePlaceTable)};
}

std::uint64_t package_size(const fs::path& folder) {
  std::uint64_t size = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file() && entry.path().filename() != kJournalFile) size += entry.file_size();
  }
  return size;
}

namespace {

// Before the work: valid as long as every pixel of the imagery is valid.
Findings check_plan(const Mission& mission, const std::vector<ImageryInput>& inputs, const TileRange& range,
                    UtcTime at) {
  const std::vector<Sidecar> planned = plan_sidecars(mission, inputs, range);
  Findings findings = check_expiry(mission, at);
  const Findings elsewhere = planned.empty() ? check_place(mission, inputs) : Findings();
  findings.add(elsewhere.empty() ? check_coverage(mission, planned) : elsewhere);
  findings.add(check_freshness(mission, planned, at));
  findings.add(check_resolution(mission, planned));
  return findings;
}

std::vector<Sha256> digests_of(std::span<const ImageryInput> inputs) {
  std::vector<Sha256> digests;
  for (const ImageryInput& input : inputs) digests.push_back(digest_of(pin_raster(input.path, input.stated_sha256)));
  return digests;
}

// Everything that a build's result depends on: what a resumed build is compared with. Reads
// every file that the rasters are made of.
std::string describe_build(const PackageRequest& request, const PreparedBuild& build) {
  std::string text = describe_tiles(request, build.mission_text, build.inputs, digests_of(build.inputs));
  std::vector<PinnedFile> heights;
  for (PinnedLayer& layer : pin_rasters(request.dem)) {
    std::move(layer.files.begin(), layer.files.end(), std::back_inserter(heights));
  }
  text += fmt::format("dem: {}\n", heights.empty() ? "none" : "sha256 " + digest_of(heights).hex());
  if (const auto& vectors = request.vectors) {
    const VectorOrigin origin = origin_of(*vectors);
    text += fmt::format("vectors: sha256 {}, attribution {}, licence {}\n", sha256_file(vectors->file).hex(),
                        origin.attribution, origin.licence);
  }
  text += fmt::format("judged at: {}\n", request.at ? to_rfc3339(*request.at) : "the mission's created");
  for (const auto& [version, root] : request.roots) {
    text += fmt::format("root {}: sha256 {}\n", version, sha256(as_bytes(root)).hex());
  }
  text += fmt::format("key: {}\n", request.key != nullptr ? request.key->public_key().id() : "none");
  return text;
}

void remove_all_but_journal(const fs::path& folder) {
  std::vector<fs::path> rest;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().filename() != kJournalFile) rest.push_back(entry.path());
  }
  for (const fs::path& path : rest) fs::remove_all(path);
}

void report_leftovers(const StagingDirectory& staging, const PackageRequest& request) {
  if (request.resume && !staging.found_leftovers()) request.on_remark("nothing to resume: building from the start");
  if (!request.resume && staging.found_leftovers()) {
    request.on_remark("discarded the files of an interrupted build; --resume would have continued it");
  }
}

}  // namespace

std::string describe_tiles(const PackageRequest& request, std::string_view mission_text,
                           std::span<const ImageryInput> inputs, std::span<const Sha256> digests) {
  std::string text =
      fmt::format("program: {}\nmission: sha256 {}\n", request.program, sha256(as_bytes(mission_text)).hex());
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    const ImageryFacts& facts = inputs[i].facts;
    text += fmt::format(
        "imagery {}: sha256 {}, captured {}, gsd {}, ce90 {}, provider {}, licence {}, attribution {}, stretch {}\n",
        i + 1, digests[i].hex(), to_rfc3339(facts.captured_at), facts.gsd_m, facts.ce90_m, facts.provider,
        facts.licence, facts.attribution, inputs[i].stretch ? to_text(*inputs[i].stretch) : "none");
  }
  text += fmt::format("seams: feather {} m\n", request.tiles.mosaic.feather_m);
  text += fmt::format("tiles: {}, quality {}{}, in {}\n", name_of(request.tiles.encoding.format),
                      request.tiles.encoding.quality, request.tiles.encoding.lossless ? ", lossless" : "",
                      file_of(request.tiles.container));
  return text;
}

PreparedBuild prepare_build(const PackageRequest& request) {
  PreparedBuild build;
  build.mission_text = read_text_file(request.mission, std::uint64_t{1} << 20);
  build.mission = parse_mission_or_throw(build.mission_text, request.mission);
  check_zoom(build.mission, request.mission);
  check_terrain_wanted(build.mission, request.mission, request.dem);
  build.inputs =
      in_order(open_imagery(request.imagery, request.overrides, request.stretches), request.tiles.mosaic.order);
  build.at = request.at.value_or(build.mission.created);
  build.range = plan_range(build.mission, build.inputs);
  build.findings = check_plan(build.mission, build.inputs, build.range, build.at);
  if (request.now) build.findings.add(check_expiry(build.mission, *request.now, Severity::warning));
  build.of_inputs = check_stated_resolution(build.inputs);  // the tiles that are made say nothing of these
  build.of_inputs.add(check_stated_places(build.inputs));
  build.of_inputs.add(check_stated_licences(build.inputs));
  prepare_layers(request, build);
  return build;
}

void prepare_layers(const PackageRequest& request, PreparedBuild& build) {
  build.terrain = prepare_terrain(build.mission, request.mission, request.dem, build.of_inputs);
  if (request.vectors && !build.rejected()) {
    build.vectors = cut_vectors(*request.vectors, build.mission, build.of_inputs);
  }
}

PackageReport fill_package(const fs::path& folder, const PackageRequest& request, const PreparedBuild& build,
                           const MakeTiles& make_tiles, Progress& progress) {
  const Mission& mission = build.mission;
  PackageReport report;
  report.zoom = mission.zoom;
  const fs::path tiles = folder / file_of(request.tiles.container);
  fs::create_directories(tiles.parent_path());
  TileSet set = make_tiles(tiles);
  set.facts.sources = stated_sources(set.sidecars, build.inputs);
  if (set.over_budget) {
    report.findings = check_budget(mission, set.tile_bytes, set.expected_bytes);
    report.findings.add(build.of_inputs);
    return report;
  }
  progress.begin("completing the package", 3, "steps");
  complete_package(folder,
                   {.mission = mission,
                    .mission_text = build.mission_text,
                    .tiles = set.facts,
                    .terrain = build.terrain,
                    .roots = request.roots,
                    .key = request.key,
                    .vectors = build.vectors ? &*build.vectors : nullptr},
                   progress);
  if (build.vectors) report.vectors = build.vectors->facts;
  if (build.terrain) report.terrain = build.terrain->grid();
  report.resumed = set.resumed;
  report.tiles = set.facts.count;
  report.merkle_root = set.facts.merkle_root;
  report.bytes = package_size(folder);
  report.findings = check_expiry(mission, build.at);
  if (request.now) report.findings.add(check_expiry(mission, *request.now, Severity::warning));
  report.findings.add(check_tile_requirements(mission, set.sidecars, report.bytes, build.at));
  report.findings.add(build.of_inputs);
  return report;
}

PackageReport build_package(const PackageRequest& request, Progress& progress) {
  const PreparedBuild build = prepare_build(request);
  PackageReport report;
  report.zoom = build.mission.zoom;
  if (build.rejected()) {
    report.findings = build.findings;
    report.findings.add(build.of_inputs);
    return report;
  }

  const std::string configuration = describe_build(request, build);
  StagingDirectory staging(request.out,
                           request.resume ? StagingDirectory::Leftovers::keep : StagingDirectory::Leftovers::discard);
  try {
    staging.keep(staging.found_leftovers() &&
                 request.resume);  // until the journal shows that they belong to this build
    report_leftovers(staging, request);
    BuildJournal journal(staging.path() / kJournalFile, configuration);
    remove_all_but_journal(staging.path());
    staging.keep(false);
    report = fill_package(
        staging.path(), request, build,
        [&](const fs::path& file) {
          return build_tile_set({build.mission, build.inputs, build.range, request.tiles}, file, journal, progress);
        },
        progress);
    if (report.findings.has_errors()) {
      progress.end();
      return report;
    }
    fs::remove(staging.path() / kJournalFile);
    progress.advance();  // the last point of interruption
    staging.commit();
    progress.end();
  } catch (const OutOfSpace& error) {
    remove_all_but_journal(staging.path());
    staging.keep(true);
    ErrorText text = error.text();
    text.fix = "free space on this disk, then run the same command with --resume: finished work is kept";
    throw OutOfSpace(text);
  }
  return report;
}

}  // namespace nadir
