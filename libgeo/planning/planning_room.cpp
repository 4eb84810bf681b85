#include "planning/planning_room.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/files.hpp"
#include "imagery/terrain_raster.hpp"
#include "mission_formats/mission_drawing.hpp"
#include "mission_formats/mission_files.hpp"
#include "planning/mission_document.hpp"
#include "raster/elevation_model.hpp"
#include "token_keys/token_key.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::size_t kProfileSamples = 400;
constexpr std::size_t kLongestName = 40;  // of the mission's id in the package's name
constexpr std::uint64_t kMaxExport = std::uint64_t{64} << 20;
constexpr std::uint64_t kMaxPrediction = std::uint64_t{256} << 20;
constexpr const char* kPredictionFile = "prediction.geojson";
const std::string kWorkPrefix = ".work-";
constexpr std::string_view kEstimateFormat = "jpeg";

// A folder that is gone when this is.
class WorkFolder {
 public:
  explicit WorkFolder(fs::path path) : path_(std::move(path)) { fs::create_directories(path_); }
  ~WorkFolder() {
    std::error_code code;
    fs::remove_all(path_, code);
  }
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

[[noreturn]] void refuse_invalid(const MissionReading& reading) {
  const Finding& first = reading.findings.items().front();
  throw UsageError({.what = "the mission is not complete",
                    .where = first.where,
                    .expected = first.expected,
                    .found = first.found,
                    .fix = first.fix});
}

const Mission& valid(const StoredMission& mission) {
  if (!mission.reading.mission) refuse_invalid(mission.reading);
  return *mission.reading.mission;
}

// "Harbour A" as an id.
std::string id_from(std::string_view name) {
  std::string id;
  for (const char c : name) {
    const bool allowed = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.';
    if (allowed) id += c;
    if (!allowed && !id.empty() && id.back() != '-') id += '-';
  }
  while (!id.empty() && (id.back() == '-' || id.back() == '.')) id.pop_back();
  while (!id.empty() && id.front() == '.') id.erase(0, 1);
  return id.empty() ? "mission" : id.substr(0, kLongestName);
}

// A path as a command in the root takes it; the URI of a token's key is none.
fs::path seen_from(const fs::path& root, const fs::path& path) {
  if (is_token_uri(path.native())) return path;
  const fs::path whole = fs::absolute(path).lexically_normal();
  const fs::path inside = whole.lexically_relative(fs::absolute(root).lexically_normal());
  return inside.empty() || *inside.begin() == ".." ? whole : inside;
}

fs::file_time_type written_at(const fs::path& file) {
  std::error_code code;
  return fs::last_write_time(file, code);
}

MapSourceOptions with_own_folders(MapSourceOptions sources, const fs::path& root) {
  sources.imagery.push_back(root / "imagery");
  sources.elevation.push_back(root / "elevation");
  sources.cameras.push_back(root / "cameras");
  sources.vectors.push_back(root / "vectors");
  return sources;
}

}  // namespace

struct PlanningRoom::Opened {
  fs::file_time_type manifest_written, signature_written;
  std::shared_ptr<const PlannedPackage> package;
};

json estimate_json(const BuildEstimate& estimate) {
  json zooms = json::array(), sectors = json::array();
  for (const ZoomEstimate& level : estimate.zooms) {
    zooms.push_back({{"zoom", level.zoom},
                     {"tiles", level.tiles},
                     {"required_tiles", level.required},
                     {"bounding_box_tiles", level.box_tiles},
                     {"megabytes", level.bytes / 1e6}});
  }
  for (const SectorEstimate& sector : estimate.sectors) {
    sectors.push_back({{"id", sector.id}, {"class", name_of(sector.cls)}, {"km2", sector.km2}});
  }
  return {{"zooms", std::move(zooms)},           {"sectors", std::move(sectors)},
          {"route_km", estimate.route_km},       {"corridor_km2", estimate.corridor_km2},
          {"needed_km2", estimate.needed_km2},   {"tiles", estimate.tiles},
          {"squares", estimate.squares},         {"sampled_squares", estimate.sampled_squares},
          {"required_tiles", estimate.required}, {"megabytes", estimate.bytes / 1e6}};
}

PlanningRoom::PlanningRoom(PlanningOptions options)
    : options_(std::move(options)),
      missions_(options_.root / "missions", options_.missions, options_.now, options_.new_id),
      sources_(with_own_folders(options_.sources, options_.root)),
      jobs_(options_.program, options_.root, options_.root / "missions") {
  for (const auto& entry : fs::directory_iterator(options_.root / "missions")) {
    if (entry.path().filename().string().starts_with(kWorkPrefix)) fs::remove_all(entry.path());  // of a killed desk
  }
}

StoredMission PlanningRoom::create(const std::string& name) {
  return missions_.create(new_document(id_from(name), options_.now()));
}

ImportedDraft PlanningRoom::import(std::string_view file_name, ByteView bytes, const std::optional<std::string>& id,
                                   const std::optional<std::string>& route, bool latitude_first) {
  const fs::path name = fs::path(file_name).filename();
  if (name.extension() == ".yaml" || name.extension() == ".yml") {
    const MissionReading reading = parse_mission(as_text(bytes), name.string());
    if (!reading.mission) refuse_invalid(reading);
    return {.mission = missions_.create(document_from(*reading.mission), as_text(bytes)), .notes = {}};
  }
  const WorkFolder work(missions_.folder_of(kWorkPrefix + options_.new_id()));
  const fs::path file = work.path() / ("drawing" + id_from(name.extension().string()));
  write_file_atomic(file, bytes);
  const MissionDrawing drawing = [&] {
    try {
      return read_mission_drawing(file, latitude_first);
    } catch (const OutOfSpace&) {
      throw;
    } catch (const Error& error) {  // what is wrong is the caller's file, whose path here is nobody's business
      ErrorText text = error.text();
      text.where = name.string();
      throw UsageError(std::move(text));
    }
  }();
  MissionImportOptions options;
  options.id = id;
  options.route = route;
  options.today = options_.now();
  if (!options.id && !drawing.mission_text) options.id = id_from(name.stem().string());
  ImportedMission imported = mission_from_drawing(drawing, options, name.string());
  if (!imported.reading.mission) refuse_invalid(imported.reading);
  // What was assumed is marked in the text: people review it.
  return {.mission = missions_.create(document_from(*imported.reading.mission)), .notes = std::move(imported.notes)};
}

Bytes PlanningRoom::exported(const StoredMission& mission, std::string_view format) const {
  const Mission& exact = valid(mission);
  if (format == "yaml") return Bytes(mission.text.begin(), mission.text.end());
  const auto known = mission_format_of(format);
  if (!known) {
    throw UsageError({.what = "there is no format of this name",
                      .expected = "yaml, plan, waypoints, kml, kmz, geojson or gpkg",
                      .found = std::string(format)});
  }
  const WorkFolder work(missions_.folder_of(kWorkPrefix + options_.new_id()));
  const fs::path file = work.path() / ("mission." + std::string(format));
  write_mission_as(exact, *known, file);
  return read_file(file, kMaxExport);
}

bool PlanningRoom::remove(std::string_view id) {
  if (jobs_.busy(id)) {
    throw PlanningConflict({.what = "a job of the mission is running", .fix = "cancel it first, or wait for it"});
  }
  return missions_.remove(id);
}

std::optional<BuildEstimate> PlanningRoom::estimate(const StoredMission& mission) const {
  if (!mission.reading.mission) return std::nullopt;
  return estimate_build(*mission.reading.mission, *tile_format_figures(kEstimateFormat));
}

std::optional<std::string> PlanningRoom::package_name(const StoredMission& mission) const {
  if (!mission.reading.mission) return std::nullopt;
  return fmt::format("{}-{}", mission.reading.mission->id.substr(0, kLongestName), mission.reading.mission->sequence);
}

std::shared_ptr<const PlannedPackage> PlanningRoom::package(const StoredMission& mission) const {
  const auto name = package_name(mission);
  if (!name) return nullptr;
  const fs::path folder = packages_folder() / *name;
  std::error_code code;
  const std::lock_guard lock(mutex_);
  if (!fs::is_regular_file(folder / kManifestFile, code)) {
    opened_.erase(*name);
    return nullptr;
  }
  const auto manifest = written_at(folder / kManifestFile), signature = written_at(folder / kSignatureFile);
  std::shared_ptr<const Opened>& opened = opened_[*name];
  if (!opened || opened->manifest_written != manifest || opened->signature_written != signature) {
    opened = std::make_shared<const Opened>(
        Opened{.manifest_written = manifest,
               .signature_written = signature,
               .package = std::make_shared<const PlannedPackage>(open_planned_package(folder))});
  }
  return opened->package;
}

void PlanningRoom::remove_package(const StoredMission& mission) {
  const auto name = package_name(mission);
  if (!name) return;
  if (jobs_.busy(mission.id)) {
    throw PlanningConflict({.what = "a job of the mission is running", .fix = "cancel it first, or wait for it"});
  }
  fs::remove(packages_folder() / *name / kManifestFile);  // first: what a kill leaves is no package
  fs::remove_all(packages_folder() / *name);
}

PlanningRoom::Profile PlanningRoom::profile(const StoredMission& mission, const std::optional<std::string>& elevation,
                                            const std::optional<std::string>& camera) const {
  const Mission& exact = valid(mission);
  std::optional<CameraModel> model;
  if (camera) {
    const auto file = sources_.camera_file(*camera);
    if (!file) throw UsageError({.what = "there is no camera of this name", .found = *camera});
    model = read_camera_file(*file).camera;
  }
  const auto of = [&](const HeightOfGround& ground, std::string_view kind) {
    return Profile{profile_of(exact, ground, model ? &*model : nullptr, kProfileSamples), kind};
  };
  if (elevation) {
    const auto file = sources_.elevation_file(*elevation);
    if (!file) throw UsageError({.what = "there is no elevation model of this name", .found = *elevation});
    const ElevationModel heights(*file);
    return of([&](LonLat place) { return heights.height_m(place); }, "elevation model");
  }
  const auto name = package_name(mission);
  const fs::path terrain = packages_folder() / name.value_or("") / kTerrainFile;
  std::error_code code;
  if (!exact.terrain.flat && fs::is_regular_file(terrain, code)) {
    const TerrainRaster heights = read_terrain_raster(terrain);
    return of([&](LonLat place) { return heights.height_m(place); }, "package");
  }
  return of([&](LonLat) { return std::optional(exact.terrain.height_m); }, "flat");
}

void PlanningRoom::start(const StoredMission& mission, const JobRequest& request) {
  const Mission& exact = valid(mission);
  const fs::path& root = options_.root;
  PackagePlan plan{.steps = request.steps,
                   .mission = fs::path("missions") / mission.id / "mission.yaml",
                   .package = fs::path("packages") / *package_name(mission),
                   .report = fs::path("missions") / mission.id,
                   .imagery = {},
                   .elevation = {},
                   .camera = {},
                   .key = {},
                   .trust = {},
                   .vectors = {},
                   .vectors_attribution = sources_.options().vectors_attribution,
                   .vectors_licence = sources_.options().vectors_licence,
                   .tile_format = request.tile_format,
                   .quality = request.quality,
                   .container = request.container,
                   .at = options_.at};
  const auto named = [&](const std::optional<fs::path>& file, const char* kind, const std::string& name) {
    if (!file) throw UsageError({.what = fmt::format("there is no {} of this name", kind), .found = name});
    return seen_from(root, *file);
  };
  for (const std::string& name : request.imagery) {
    plan.imagery.push_back(named(sources_.imagery_file(name), "imagery", name));
  }
  if (request.elevation)
    plan.elevation = named(sources_.elevation_file(*request.elevation), "elevation model", *request.elevation);
  if (request.camera) plan.camera = named(sources_.camera_file(*request.camera), "camera", *request.camera);
  if (request.vectors) plan.vectors = named(sources_.vectors_file(*request.vectors), "vectors", *request.vectors);
  if (request.key) plan.key = named(sources_.key_file(*request.key), "key", *request.key);
  if (sources_.trust()) plan.trust = seen_from(root, *sources_.trust());

  const auto wants = [&](PackageStep step) {
    return std::find(plan.steps.begin(), plan.steps.end(), step) != plan.steps.end();
  };
  const auto need = [&](bool given, PackageStep step, const char* what) {
    if (!wants(step) || given) return;
    throw UsageError({.what = fmt::format("the step \"{}\" needs {}", name_of(step), what)});
  };
  need(!plan.imagery.empty(), PackageStep::build, "imagery");
  need(!plan.imagery.empty(), PackageStep::estimate, "imagery");
  need(exact.terrain.flat || plan.elevation, PackageStep::build,
       "an elevation model: the mission's terrain is \"dem\"");
  need(plan.key.has_value(), PackageStep::sign, "a key: start the desk with --key");
  need(plan.trust.has_value(), PackageStep::verify, "a root of trust: start the desk with --trust");
  need(plan.camera.has_value(), PackageStep::predict, "a camera");
  if (exact.terrain.flat) plan.elevation.reset();
  std::error_code code;
  if (wants(PackageStep::build) && fs::exists(root / plan.package, code)) {
    throw PlanningConflict({.what = "the package exists already",
                            .found = plan.package.filename().string(),
                            .fix = "raise the mission's sequence, or delete that package"});
  }
  write_file_atomic(root / plan.mission, mission.text);
  if (!jobs_.start(mission.id, std::move(plan))) {
    throw PlanningConflict({.what = "a job of the mission is running", .fix = "cancel it first, or wait for it"});
  }
}

std::optional<std::string> PlanningRoom::prediction(const StoredMission& mission) const {
  const fs::path file = missions_.folder_of(mission.id) / kPredictionFile;
  std::error_code code;
  if (!fs::is_regular_file(file, code)) return std::nullopt;
  return read_text_file(file, kMaxPrediction);
}

std::optional<bool> PlanningRoom::prediction_is_current(const StoredMission& mission) const {
  const fs::path folder = missions_.folder_of(mission.id);
  std::error_code code;
  if (!fs::is_regular_file(folder / kPredictionFile, code)) return std::nullopt;
  return read_text_file(folder / "mission.yaml") == mission.text;
}

}  // namespace nadir
