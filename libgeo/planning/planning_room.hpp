// Missions at a desk: drafts, what their maps can be made of, their packages, and the jobs that make them.
//
//   ROOT/missions/ID/draft.json   the document (mission_store.hpp)
//   ROOT/missions/ID/mission.yaml what the jobs read; job.json, prediction.geojson: what they reported
//   ROOT/packages/MISSION-SEQUENCE   the package, where flights look for theirs
//   ROOT/imagery, ROOT/elevation, ROOT/cameras   sources, besides those that are named at the start
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "package_build/build_estimate.hpp"
#include "planning/map_sources.hpp"
#include "planning/mission_store.hpp"
#include "planning/package_jobs.hpp"
#include "planning/package_layers.hpp"
#include "planning/route_profile.hpp"

namespace nadir {

struct PlanningOptions {
  std::filesystem::path root;  // of the desk
  MapSourceOptions sources;
  std::filesystem::path program;  // nadir itself
  std::optional<UtcTime> at;      // evaluate packages as of this time instead of the present
  std::size_t missions = 1000;
  std::function<UtcTime()> now;
  std::function<std::string()> new_id;
};

// What a job is asked to do, by the names of the sources.
struct JobRequest {
  std::vector<PackageStep> steps;
  std::vector<std::string> imagery;
  std::optional<std::string> elevation, camera, key, vectors;
  std::string tile_format = "jpeg";
  int quality = 75;
  std::string container = "mbtiles";
};

// Not now: the mission has a job, or a package, that stands in the way.
class PlanningConflict : public Error {
 public:
  using Error::Error;
};

struct ImportedDraft {
  StoredMission mission;
  Findings notes;
};

// As `nadir mission plan --json` prints it.
nlohmann::json estimate_json(const BuildEstimate& estimate);

class PlanningRoom {
 public:
  explicit PlanningRoom(PlanningOptions options);

  MissionStore& missions() { return missions_; }
  const MapSources& sources() const { return sources_; }
  const PackageJobs& jobs() const { return jobs_; }

  StoredMission create(const std::string& name);
  // A mission.yaml, or a plan or drawing of another program. file_name: tells its format's ending. Throws UsageError.
  ImportedDraft import(std::string_view file_name, ByteView bytes, const std::optional<std::string>& id,
                       const std::optional<std::string>& route, bool latitude_first);
  // As a file of another program, or "yaml". Throws UsageError where the mission is not valid, or the format is none.
  Bytes exported(const StoredMission& mission, std::string_view format) const;
  bool remove(std::string_view id);  // the draft alone. Throws PlanningConflict while a job runs

  // By figures measured once; of a valid mission.
  std::optional<BuildEstimate> estimate(const StoredMission& mission) const;

  // Name and folder of its package, which need not exist; nothing while the mission is not valid.
  std::optional<std::string> package_name(const StoredMission& mission) const;
  std::shared_ptr<const PlannedPackage> package(const StoredMission& mission) const;  // null: there is none
  void remove_package(const StoredMission& mission);

  // elevation: the name of a source; else the package's terrain, else flat ground.
  struct Profile {
    RouteProfile profile;
    std::string_view ground;  // "flat", "package", "elevation model"
  };
  Profile profile(const StoredMission& mission, const std::optional<std::string>& elevation,
                  const std::optional<std::string>& camera) const;

  // Throws UsageError for a mission that is not valid and for sources that are unknown, PlanningConflict.
  void start(const StoredMission& mission, const JobRequest& request);
  bool cancel(std::string_view id) { return jobs_.cancel(id); }
  std::optional<std::string> prediction(const StoredMission& mission) const;      // GeoJSON
  std::optional<bool> prediction_is_current(const StoredMission& mission) const;  // nothing: there is none

 private:
  std::filesystem::path packages_folder() const { return options_.root / "packages"; }

  const PlanningOptions options_;
  MissionStore missions_;
  MapSources sources_;
  PackageJobs jobs_;
  mutable std::mutex mutex_;
  struct Opened;
  mutable std::map<std::string, std::shared_ptr<const Opened>> opened_;  // packages, by name
};

}  // namespace nadir
