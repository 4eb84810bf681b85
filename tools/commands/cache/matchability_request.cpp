#include "commands/cache/matchability_request.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/error.hpp"
#include "base/plural.hpp"
#include "package/open_package.hpp"
#include "package/tile_container.hpp"
#include "vision/camera.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/map_matcher.hpp"
#include "vision/matching_plan.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr double kPlainTemplate_px = 130;  // side of a square with the pixels of a frame of 170 x 100
constexpr std::array<MatchClass, 3> kClasses{MatchClass::good, MatchClass::weak, MatchClass::poor};

// The square of the frame's area, and the scale at which a flight with this camera searches.
MatchabilityOptions options_for(const Mission& mission, const MatchabilityRequest& request, double map_gsd_m) {
  double footprint_m = request.footprint_m.value_or(mission.route.agl_m);
  double gsd_m = std::max(map_gsd_m, footprint_m / kPlainTemplate_px);
  if (request.camera) {
    const CameraModel camera = read_camera_file(*request.camera).camera;
    if (!request.footprint_m) {
      footprint_m = square_footprint_m(camera, mission.route.agl_m);
      gsd_m = matching_scale(camera, mission.route.agl_m, map_gsd_m).coarse_gsd_m;
    }
  }
  return matchability_options(footprint_m, gsd_m, request.search_m);
}

std::string percent(double share) { return fmt::format("{:.1f} %", 100 * share); }

std::string metres(double length_m) {
  return length_m < 10'000 ? fmt::format("{:.0f} m", length_m) : fmt::format("{:.1f} km", length_m / 1000);
}

std::string describe(const RouteSection& stretch, const std::optional<double>& cruise_mps) {
  std::string text = metres(stretch.length_m);
  if (cruise_mps) text += fmt::format(", {:.0f} s at {:g} m/s", stretch.length_m / *cruise_mps, *cruise_mps);
  return text + fmt::format(", from {:.6f},{:.6f} to {:.6f},{:.6f}", stretch.from.lon_deg, stretch.from.lat_deg,
                            stretch.to.lon_deg, stretch.to.lat_deg);
}

}  // namespace

void MatchabilityRequest::declare(Options& options) {
  options.value("--camera", camera, "FILE.yaml",
                "camera of the flight; with the mission's height it gives the footprint");
  options
      .value("--footprint-m", footprint_m, "M",
             "side of the square that a frame covers; default: from the camera, else the height above ground")
      .between(20, 5000);
  options.value("--search-m", search_m, "M", "search radius of the flight").between(60, 1200);
  options.value("--step-m", step_m, "M", "spacing of the places").between(5, 5000);
  options.value("--speed-mps", cruise_mps, "V", "ground speed, to give route segments in seconds as well")
      .between(1, 300)
      .formerly("--cruise-mps");
  options.value("--threads", threads, "N", "threads; default: one per processor").between(1, 256);
}

std::optional<VectorLayer> read_package_vectors(const std::filesystem::path& package, const Manifest& manifest) {
  const Artifact* artifact = manifest.artifact(kRoleVectors);
  if (artifact == nullptr) return std::nullopt;
  return parse_vectors(read_artifact(package, *artifact, kMaxVectors_bytes), artifact->path);
}

int MatchabilityRequest::thread_count() const {
  return threads.value_or(static_cast<int>(std::max(1U, std::thread::hardware_concurrency())));
}

RequestedSurvey::RequestedSurvey(const TileSource& tiles, const Mission& mission, const VectorLayer* vectors,
                                 const MatchabilityRequest& request)
    : mission_(mission),
      frame_(mission_frame(mission)),
      region_(required_region(mission, frame_)),
      ground_(tiles, vectors == nullptr ? without_ : *vectors),
      result_{.options = options_for(mission, request, ground_resolution_m(tiles.zooms().max, mission.takeoff.lat_deg)),
              .step_m = request.step_m,
              .cruise_mps = request.cruise_mps},
      survey_({ground_, region_, frame_, mission.zoom.max, request.step_m}, result_.options) {
  if (vectors != nullptr) result_.water_areas = ground_.areas();
}

MatchabilityResult RequestedSurvey::finish() {
  result_.map = survey_.take();
  result_.summary = summarize_matchability(result_.map, mission_.route.points, frame_);
  return std::move(result_);
}

MatchabilityResult make_matchability(const std::filesystem::path& tiles, const Mission& mission,
                                     const VectorLayer* vectors, const MatchabilityRequest& request,
                                     Progress& progress) {
  const std::unique_ptr<TileSource> source = open_tile_source(tiles);
  RequestedSurvey survey(*source, mission, vectors, request);
  do_alone(survey.work(), request.thread_count(), progress);
  return survey.finish();
}

Figures figures_of(const MatchabilityResult& result) {
  const MatchabilitySummary& summary = result.summary;
  Figures figures{{"places", fmt::format("{}, {:g} m apart, each a frame of {:.0f} m", summary.places(), result.step_m,
                                         result.options.footprint_m)}};
  for (const MatchClass cls : kClasses) {
    figures.emplace_back(name_of(cls), fmt::format("{} of the places, {} of the route", percent(summary.share(cls)),
                                                   percent(summary.route_share(cls))));
  }
  if (result.water_areas) {
    figures.emplace_back("water", fmt::format("{} of the package's vectors: no ground to match with",
                                              count(*result.water_areas, "area")));
  }
  figures.emplace_back("longest segment without a good place",
                       summary.without_good.empty() ? std::string("none: the whole route is good")
                                                    : describe(summary.without_good.front(), result.cruise_mps));
  return figures;
}

json json_of(const MatchabilityResult& result) {
  const MatchabilitySummary& summary = result.summary;
  json document{{"places", summary.places()},
                {"step_m", result.step_m},
                {"footprint_m", rounded(result.options.footprint_m, 10)},
                {"search_m", rounded(result.options.radius_m, 10)},
                {"gsd_m", rounded(result.options.gsd_m, 1000)},
                {"good_ratio", result.options.limits.good_ratio},
                {"weak_ratio", result.options.limits.weak_ratio},
                {"min_score", result.options.limits.min_score},
                {"route_m", rounded(summary.route_length_m(), 10)}};
  for (const MatchClass cls : kClasses) {
    document["share"][name_of(cls)] = rounded(summary.share(cls), 1e4);
    document["route_share"][name_of(cls)] = rounded(summary.route_share(cls), 1e4);
  }
  if (result.water_areas) document["water_areas"] = *result.water_areas;
  json& stretches = document["without_good"] = json::array();
  for (const RouteSection& stretch : summary.without_good) {
    json item{{"length_m", rounded(stretch.length_m, 10)},
              {"begin_m", rounded(stretch.begin_m, 10)},
              {"from", {rounded(stretch.from.lon_deg, 1e7), rounded(stretch.from.lat_deg, 1e7)}},
              {"to", {rounded(stretch.to.lon_deg, 1e7), rounded(stretch.to.lat_deg, 1e7)}}};
    if (result.cruise_mps) item["seconds"] = rounded(stretch.length_m / *result.cruise_mps, 10);
    stretches.push_back(std::move(item));
  }
  return document;
}

}  // namespace nadir
