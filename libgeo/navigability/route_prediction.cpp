#include "navigability/route_prediction.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "base/error.hpp"
#include "base/ordered_work.hpp"
#include "estimation/localizer.hpp"
#include "geodesy/angles.hpp"
#include "navigability/navigability_parameters.hpp"
#include "navigability/protection_forecast.hpp"
#include "raster/single_opencv_thread.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/matching_plan.hpp"
#include "vision/rectification.hpp"

namespace nadir {
using namespace parameters::navigability;
namespace {

constexpr std::size_t kMaxLooks = 100'000;
constexpr std::int64_t kSecondsPerDay = 86'400;

struct RoutePoint {
  double at_m;
  PlanePoint place;
  double height;  // as the route states it
};

// Ground heights, from the package's terrain or flat.
class GroundHeights {
 public:
  GroundHeights(const Mission& mission, const TerrainRaster* terrain)
      : flat_m_(mission.terrain.height_m), terrain_(terrain) {}
  double at(LonLat place) const {
    if (terrain_ == nullptr) return flat_m_;
    return terrain_->height_m(place).value_or(flat_m_);
  }

 private:
  double flat_m_;
  const TerrainRaster* terrain_;
};

double height_at(const Mission& mission, std::size_t segment, double share, double ground_m, double takeoff_m) {
  const double a = height_above_ground_m(mission, segment, ground_m, takeoff_m);
  const double b = height_above_ground_m(mission, segment + 1, ground_m, takeoff_m);
  return a + share * (b - a);
}

std::vector<PredictedLook> looks_along(const Mission& mission, const LocalFrame& frame, const GroundHeights& ground,
                                       double spacing_m, const CameraModel& camera, double& route_m) {
  const PlanePath path = to_plane(frame, mission.route.points);
  const double takeoff_m = ground.at(mission.takeoff);
  route_m = length_m(path);
  if (route_m / spacing_m > static_cast<double>(kMaxLooks)) {
    throw UsageError({.what = "the route has too many frames to predict",
                      .where = "mission " + mission.id,
                      .expected = fmt::format("at most {}", kMaxLooks),
                      .found = fmt::format("{:.0f}", route_m / spacing_m),
                      .fix = "use a larger --spacing-m"});
  }
  std::vector<PredictedLook> looks;
  double leg_begin_m = 0, next_m = 0;
  for (std::size_t i = 1; i < path.size(); ++i) {
    const double leg_m = distance_m(path[i - 1], path[i]);
    for (; next_m <= leg_begin_m + leg_m; next_m += spacing_m) {
      const double share = leg_m > 0 ? (next_m - leg_begin_m) / leg_m : 0;
      PredictedLook look;
      look.at_m = next_m;
      look.place = frame.lonlat_from_plane(path[i - 1] + share * (path[i] - path[i - 1]));
      look.agl_m = height_at(mission, i - 1, share, ground.at(look.place), takeoff_m);
      look.frame_width_m = std::max(0.0, look.agl_m) * camera.width / camera.fx;
      look.frame_height_m = std::max(0.0, look.agl_m) * camera.height / camera.fy;
      looks.push_back(look);
    }
    leg_begin_m += leg_m;
  }
  return looks;
}

const Sidecar* sidecar_of(std::span<const Sidecar> sidecars, const TileKey& key) {
  const auto found = std::lower_bound(sidecars.begin(), sidecars.end(), key,
                                      [](const Sidecar& a, const TileKey& b) { return a.key < b; });
  return found == sidecars.end() || found->key != key ? nullptr : &*found;
}

LegVerdict verdict_of(double share) {
  if (share >= kGoodLook) return LegVerdict::good;
  return share < kPoorLook ? LegVerdict::poor : LegVerdict::fair;
}

double anchored_share(const PredictedLook& look, double start_m) {
  return look.at_m < start_m ? look.probability : look.anchored_share;
}

bool beyond_limit(const PredictedLook& look, double alert_limit_m) {
  return !look.hpl_m || *look.hpl_m > alert_limit_m;
}

struct FlownFrames {
  std::vector<ForecastFrame> frames;
  std::vector<std::size_t> looks;  // of each frame, the nearest one
};

// The frames of the flight, which may be closer together than the looks that are predicted, or farther apart.
FlownFrames frames_along(const std::vector<PredictedLook>& looks, const LocalFrame& frame,
                         const PredictionOptions& options, double spacing_m) {
  FlownFrames flown;
  const double speed_mps = options.speed_mps.value_or(kUsualSpeed_mps);
  const double step_m = std::max(looks.back().at_m / static_cast<double>(kMaxLooks),  // bounds time and memory
                                 options.interval_s ? *options.interval_s * speed_mps : spacing_m);
  std::optional<double> course_rad;
  std::size_t behind = 0;
  for (double at_m = 0; at_m <= looks.back().at_m; at_m += step_m) {
    while (behind + 2 < looks.size() && looks[behind + 1].at_m <= at_m) ++behind;
    const std::size_t ahead = std::min(behind + 1, looks.size() - 1);
    const PredictedLook &a = looks[behind], &b = looks[ahead];
    const double share = ahead > behind ? std::clamp((at_m - a.at_m) / (b.at_m - a.at_m), 0.0, 1.0) : 0;
    const PlanePoint from = frame.plane_from_lonlat(a.place);
    ForecastFrame next;
    next.place = from + share * (frame.plane_from_lonlat(b.place) - from);
    next.agl_m = std::max(1.0, a.agl_m + share * (b.agl_m - a.agl_m));
    next.along_m = next.agl_m * options.camera.height / options.camera.fy;
    next.footprint_m = footprint_side_m(options.camera, next.agl_m);
    next.fine_gsd_m = matching_scale(options.camera, next.agl_m, a.features.map_gsd_m).fine_gsd_m;
    next.map_sigma_m = a.map_sigma_m;
    next.probability = a.probability + share * (b.probability - a.probability);
    next.bare = is_bare((share < 0.5 ? a : b).features);
    if (!flown.frames.empty()) {
      const Eigen::Vector2d way = next.place - flown.frames.back().place;
      const double course = std::atan2(way.x(), way.y());
      next.way_m = step_m;
      next.seconds = step_m / speed_mps;
      next.turn_rad = course_rad ? wrap_pi(course - *course_rad) : 0;
      course_rad = course;
    }
    flown.frames.push_back(next);
    flown.looks.push_back(share < 0.5 ? behind : ahead);
  }
  return flown;
}

// A look has the level of its frame, the worst of several, or that of the frame behind.
void predict_protection(std::vector<PredictedLook>& looks, const Mission& mission, const LocalFrame& frame,
                        const PredictionOptions& options, double frame_spacing_m, Progress& progress) {
  const FlownFrames flown = frames_along(looks, frame, options, frame_spacing_m);
  const ForecastSetup setup{.uncertainty = options.uncertainty,
                            .integrity_risk = mission.integrity.risk,
                            .alert_limit_m = mission.integrity.alert_limit_m,
                            .area = required_region(mission, frame).bounds(),
                            .threads = options.threads};
  const std::vector<ForecastLevel> levels = forecast_levels(flown.frames, setup, progress);
  std::size_t next = 0;  // frame that no look has had
  for (std::size_t k = 0; k < looks.size(); ++k) {
    const std::size_t first =
        next < levels.size() && flown.looks[next] == k ? next : std::max<std::size_t>(next, 1) - 1;
    while (next < levels.size() && flown.looks[next] == k) ++next;
    ForecastLevel worst = levels[first];
    for (std::size_t i = first + 1; i < next; ++i) {
      const ForecastLevel& level = levels[i];
      worst.hpl_m = worst.hpl_m && level.hpl_m ? std::optional(std::max(*worst.hpl_m, *level.hpl_m)) : std::nullopt;
      worst.beyond_share = std::max(worst.beyond_share, level.beyond_share);
      worst.anchored_share = std::min(worst.anchored_share, level.anchored_share);
      worst.since_anchor_m = std::max(worst.since_anchor_m, level.since_anchor_m);
    }
    looks[k].hpl_m = worst.hpl_m;
    looks[k].beyond_share = worst.beyond_share;
    looks[k].anchored_share = worst.anchored_share;
    looks[k].since_anchor_m = worst.since_anchor_m;
  }
}

// Along the route, until the level is within the limit for the first time.
double start_of(const std::vector<PredictedLook>& looks, double alert_limit_m, double route_m) {
  const auto within =
      std::find_if(looks.begin(), looks.end(), [&](const auto& look) { return !beyond_limit(look, alert_limit_m); });
  return within == looks.end() ? route_m : within->at_m;
}

std::string reason_of(const PredictedLeg& leg, const std::vector<PredictedLook>& looks) {
  double valid = 0, ratio = 0, score = 0, footprint_px = 0;
  const auto n = static_cast<double>(leg.last - leg.first + 1);
  for (std::size_t i = leg.first; i <= leg.last; ++i) {
    const ProbedGround& look = looks[i].features;
    valid += look.valid / n;
    ratio += look.ratio / n;
    score += std::exp(look.log_score) / n;
    footprint_px += look.footprint_m / look.map_gsd_m / n;
  }
  if (valid < kMinValidShare) return "the package has no map here";
  if (footprint_px < kSmallFootprint_px) {
    return fmt::format("a frame is only {:.0f} pixels of the map wide at {:.0f} m above ground", footprint_px,
                       looks[leg.first].agl_m);
  }
  if (score < kLeastScore) return "the ground has little structure that lasts: water, bare fields, wood";
  if (ratio > kGoodRatio) return "other places look alike: rows of crops, repeated buildings";
  if (std::max(leg.probability, leg.anchored_share) >= kGoodLook)
    return "looks before this leg leave the position in doubt";
  return "looks anchor now and then only";
}

// Tries what a planner could change.
std::vector<std::string> remedies_for(const PredictedLeg& leg, const std::vector<PredictedLook>& looks,
                                      const Mission& mission, const LocalFrame& frame, LookProbes& probes,
                                      int freshness_days) {
  std::vector<std::string> remedies;
  std::vector<std::size_t> tried;
  for (std::size_t i = 0; i < kRemedySamples; ++i)
    tried.push_back(leg.first + (leg.last - leg.first) * i / std::max<std::size_t>(1, kRemedySamples - 1));
  tried.erase(std::unique(tried.begin(), tried.end()), tried.end());
  const auto mean = [&](const std::function<double(std::size_t)>& probability) {
    double sum = 0;
    for (const std::size_t i : tried) sum += probability(i);
    return sum / static_cast<double>(tried.size());
  };
  const double now = mean([&](std::size_t i) { return looks[i].probability; });
  const auto helps = [&](double probability) {
    return (now < kGoodLook && probability >= kGoodLook) || probability >= now + kUsefulGain;
  };
  for (const double factor : kHeightTrials) {
    const double probability =
        mean([&](std::size_t i) { return anchor_probability(probes.look(looks[i].place, looks[i].agl_m * factor)); });
    if (!helps(probability)) continue;
    remedies.push_back(
        fmt::format("fly this leg at {:.0f} m above ground instead of {:.0f} m: {:.0f} % of the looks would anchor",
                    looks[leg.first].agl_m * factor, looks[leg.first].agl_m, 100 * probability));
    break;
  }
  const PlanePoint a = frame.plane_from_lonlat(looks[leg.first].place),
                   b = frame.plane_from_lonlat(looks[leg.last].place);
  const double length = distance_m(a, b);
  if (length > 0) {
    const PlanePoint right{(b.north_m - a.north_m) / length, -(b.east_m - a.east_m) / length};
    for (const double side : {1.0, -1.0}) {
      const double shift_m =
          side * 2 * std::max(mission.route.corridor_half_width_m, looks[leg.first].frame_width_m / 2);
      const double probability = mean([&](std::size_t i) {
        const PlanePoint at = frame.plane_from_lonlat(looks[i].place);
        const PlanePoint moved{at.east_m + shift_m * right.east_m, at.north_m + shift_m * right.north_m};
        return anchor_probability(probes.look(frame.lonlat_from_plane(moved), looks[i].agl_m));
      });
      if (!helps(probability)) continue;
      remedies.push_back(fmt::format("move this leg {:.0f} m to the {}: {:.0f} % of the looks would anchor",
                                     std::abs(shift_m), side > 0 ? "right" : "left", 100 * probability));
      break;
    }
  }
  const PredictedLook& first = looks[leg.first];
  if (first.imagery_age_days && *first.imagery_age_days > freshness_days) {
    remedies.push_back(fmt::format("use fresher imagery: this is {} days old", *first.imagery_age_days));
  }
  if (first.features.footprint_m / first.features.map_gsd_m < kSmallFootprint_px) {
    remedies.push_back(fmt::format("use imagery finer than {:.2f} m", first.features.map_gsd_m));
  }
  return remedies;
}

}  // namespace

std::string_view name_of(LegVerdict verdict) {
  switch (verdict) {
    case LegVerdict::good: return "good";
    case LegVerdict::fair: return "fair";
    case LegVerdict::poor: return "poor";
  }
  return "poor";
}

std::vector<PredictedLeg> legs_of(const std::vector<PredictedLook>& looks, double alert_limit_m, double route_m,
                                  double start_m) {
  std::vector<PredictedLeg> legs;
  if (looks.empty()) return legs;
  // Smoothed over a short section: one odd probe is no leg.
  std::vector<LegVerdict> verdicts;
  for (std::size_t i = 0; i < looks.size(); ++i) {
    double sum = 0, number = 0;
    for (std::size_t k = i; k < looks.size() && looks[k].at_m - looks[i].at_m <= kShortLeg_m / 2; ++k)
      sum += anchored_share(looks[k], start_m), ++number;
    for (std::size_t k = i; k-- > 0 && looks[i].at_m - looks[k].at_m <= kShortLeg_m / 2;)
      sum += anchored_share(looks[k], start_m), ++number;
    verdicts.push_back(verdict_of(sum / number));
  }
  for (std::size_t i = 0; i < looks.size(); ++i) {
    const bool beyond = looks[i].at_m >= start_m && beyond_limit(looks[i], alert_limit_m);
    if (legs.empty() || legs.back().verdict != verdicts[i] || legs.back().beyond_alert_limit != beyond) {
      legs.push_back(
          {.verdict = verdicts[i], .beyond_alert_limit = beyond, .first = i, .begin_m = looks[i].at_m, .hpl_m = 0.0});
    }
    legs.back().last = i;
  }
  for (std::size_t i = 0; i < legs.size(); ++i) {
    PredictedLeg& leg = legs[i];
    leg.length_m = (i + 1 < legs.size() ? legs[i + 1].begin_m : route_m) - leg.begin_m;
    for (std::size_t k = leg.first; k <= leg.last; ++k) {
      leg.probability += looks[k].probability / static_cast<double>(leg.last - leg.first + 1);
      leg.anchored_share += anchored_share(looks[k], start_m) / static_cast<double>(leg.last - leg.first + 1);
      if (looks[k].at_m < start_m) continue;
      leg.hpl_m = leg.hpl_m && looks[k].hpl_m ? std::optional(std::max(*leg.hpl_m, *looks[k].hpl_m)) : std::nullopt;
    }
  }
  return legs;
}

RoutePrediction predict_route(const Mission& mission, const TileSource& tiles, std::span<const Sidecar> sidecars,
                              const TerrainRaster* terrain, const PredictionOptions& options, Progress& progress) {
  if (mission.route.points.empty()) {
    throw UsageError({.what = "the mission has no route",
                      .where = "mission " + mission.id,
                      .expected = "a route to predict along",
                      .found = "an area alone",
                      .fix = "`nadir cache matchability` maps an area"});
  }
  const SingleOpenCvThread one_thread;
  const LocalFrame frame = mission_frame(mission);
  const GroundHeights ground(mission, terrain);
  RoutePrediction prediction;
  prediction.terrain_known = terrain != nullptr || mission.terrain.flat || mission.route.all_above_ground();
  prediction.alert_limit_m = mission.integrity.alert_limit_m;
  const double frame_spacing_m =
      std::max(kLeastSpacing_m, (1 - kFrameOverlap) * options.camera.height / options.camera.fy * mission.route.agl_m);
  // One look for each frame: farther apart, a look has the worst level of several.
  const double flown_m = options.interval_s.value_or(0) * options.speed_mps.value_or(kUsualSpeed_mps);
  prediction.spacing_m = options.spacing_m.value_or(std::max(frame_spacing_m, flown_m));
  prediction.looks = looks_along(mission, frame, ground, prediction.spacing_m, options.camera, prediction.route_m);
  std::vector<PredictedLook>& looks = prediction.looks;

  std::vector<LonLat> texture_places;
  const std::size_t stride = std::max<std::size_t>(1, looks.size() / kTextureSamples);
  for (std::size_t i = 0; i < looks.size(); i += stride) texture_places.push_back(looks[i].place);
  const double texture = typical_texture(tiles, frame, options.camera, mission.route.agl_m, texture_places);
  const int zoom = tiles.zooms().max;
  progress.begin("predicting looks", looks.size(), "frames");
  const auto make_worker = [&]() -> std::function<ProbedGround(std::size_t)> {
    auto probes = std::make_shared<LookProbes>(tiles, frame, options.camera, options.search_m, texture);
    return [&looks, probes](std::size_t i) {
      return looks[i].agl_m > 0 ? probes->look(looks[i].place, looks[i].agl_m) : ProbedGround{};
    };
  };
  work_in_order<ProbedGround>(
      looks.size(), options.threads, make_worker, [&](std::size_t i, const ProbedGround& features) {
        looks[i].features = features;
        looks[i].probability = looks[i].agl_m > 0 ? anchor_probability(features) : 0;
        looks[i].map_sigma_m = parameters::localizer::kMapSigma_m;
        if (const Sidecar* tile = sidecar_of(sidecars, tile_at(looks[i].place, zoom))) {
          looks[i].imagery_age_days = static_cast<int>((options.at.unix_s - tile->captured_at.unix_s) / kSecondsPerDay);
          looks[i].map_sigma_m = map_sigma_from_ce90(static_cast<double>(tile->ce90_mm) / 1000);
        }
        progress.advance();
        return true;
      });
  progress.end();

  predict_protection(looks, mission, frame, options, frame_spacing_m, progress);
  prediction.start_m = start_of(looks, prediction.alert_limit_m, prediction.route_m);
  const double usual_start_m = kUsualStartFootprints * footprint_side_m(options.camera, std::max(1.0, looks[0].agl_m));
  prediction.legs = legs_of(looks, prediction.alert_limit_m, prediction.route_m,
                            prediction.start_m <= usual_start_m ? prediction.start_m : 0);
  LookProbes probes(tiles, frame, options.camera, options.search_m, texture);
  progress.begin("trying remedies", prediction.legs.size(), "legs");
  for (PredictedLeg& leg : prediction.legs) {
    if (leg.beyond_alert_limit) prediction.beyond_m += leg.length_m;
    (leg.verdict == LegVerdict::good   ? prediction.good_m
     : leg.verdict == LegVerdict::fair ? prediction.fair_m
                                       : prediction.poor_m) += leg.length_m;
    progress.advance();
    if (leg.verdict == LegVerdict::good && !leg.beyond_alert_limit) continue;
    leg.reason =
        looks[leg.first].agl_m <= 0 ? "the route meets the ground"
        : leg.beyond_alert_limit && leg.begin_m < prediction.start_m
            ? "the start is not confirmed: looks at different ground have to agree first, and " + reason_of(leg, looks)
            : reason_of(leg, looks);
    if (looks[leg.first].agl_m <= 0 || (leg.verdict == LegVerdict::fair && !leg.beyond_alert_limit)) continue;
    leg.remedies = remedies_for(leg, looks, mission, frame, probes, mission.freshness_days.active);
  }
  progress.end();
  return prediction;
}

}  // namespace nadir
