#include "navigability/route_prediction.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "base/error.hpp"
#include "base/ordered_work.hpp"
#include "navigability/navigability_parameters.hpp"
#include "raster/single_opencv_thread.hpp"
#include "vision/localizer_parameters.hpp"

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

std::optional<int> age_days(std::span<const Sidecar> sidecars, const TileKey& key, UtcTime at) {
  const auto found = std::lower_bound(sidecars.begin(), sidecars.end(), key,
                                      [](const Sidecar& a, const TileKey& b) { return a.key < b; });
  if (found == sidecars.end() || found->key != key) return std::nullopt;
  return static_cast<int>((at.unix_s - found->captured_at.unix_s) / kSecondsPerDay);
}

LegVerdict verdict_of(double probability) {
  if (probability >= kGoodLook) return LegVerdict::good;
  return probability < kPoorLook ? LegVerdict::poor : LegVerdict::fair;
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
  if (leg.verdict == LegVerdict::good) return "few looks anchor before this leg";
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
  const auto helps = [&](double probability) { return probability >= kGoodLook || probability >= now + kUsefulGain; };
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

void predict_protection(std::vector<PredictedLook>& looks) {
  for (std::size_t i = 0; i < looks.size(); ++i) {
    // Backwards, until nine flights of ten have anchored. Looks closer than the correlation count as one, the best.
    double none = 1, best = 0, group_end_m = looks[i].at_m;
    std::size_t k = i + 1;
    double since_m = looks[i].at_m - looks.front().at_m + kUnanchoredStart_m;
    while (k-- > 0) {
      if (group_end_m - looks[k].at_m >= kLookCorrelation_m) none *= 1 - best, best = 0, group_end_m = looks[k].at_m;
      best = std::max(best, looks[k].probability);
      if (none * (1 - best) <= 1 - kProtectionShare) {
        since_m = looks[i].at_m - looks[k].at_m;
        break;
      }
    }
    looks[i].since_anchor_m = since_m;
    looks[i].hpl_m = kAnchoredProtection_m + kProtectionPerMetre * since_m;
  }
}

std::vector<PredictedLeg> legs_of(const std::vector<PredictedLook>& looks, double alert_limit_m, double route_m) {
  std::vector<PredictedLeg> legs;
  if (looks.empty()) return legs;
  // Smoothed over a short section: one odd probe is no leg.
  std::vector<LegVerdict> verdicts;
  for (std::size_t i = 0; i < looks.size(); ++i) {
    double sum = 0, number = 0;
    for (std::size_t k = i; k < looks.size() && looks[k].at_m - looks[i].at_m <= kShortLeg_m / 2; ++k)
      sum += looks[k].probability, ++number;
    for (std::size_t k = i; k-- > 0 && looks[i].at_m - looks[k].at_m <= kShortLeg_m / 2;)
      sum += looks[k].probability, ++number;
    verdicts.push_back(verdict_of(sum / number));
  }
  for (std::size_t i = 0; i < looks.size(); ++i) {
    const bool beyond = looks[i].hpl_m > alert_limit_m;
    if (legs.empty() || legs.back().verdict != verdicts[i] || legs.back().beyond_alert_limit != beyond) {
      legs.push_back({verdicts[i], beyond, i, i, looks[i].at_m, 0, 0, 0});
    }
    legs.back().last = i;
  }
  for (std::size_t i = 0; i < legs.size(); ++i) {
    PredictedLeg& leg = legs[i];
    leg.length_m = (i + 1 < legs.size() ? legs[i + 1].begin_m : route_m) - leg.begin_m;
    for (std::size_t k = leg.first; k <= leg.last; ++k) {
      leg.probability += looks[k].probability / static_cast<double>(leg.last - leg.first + 1);
      leg.hpl_m = std::max(leg.hpl_m, looks[k].hpl_m);
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
  prediction.spacing_m = options.spacing_m.value_or(
      std::max(kLeastSpacing_m, (1 - kFrameOverlap) * options.camera.height / options.camera.fy * mission.route.agl_m));
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
        looks[i].imagery_age_days = age_days(sidecars, tile_at(looks[i].place, zoom), options.at);
        progress.advance();
        return true;
      });
  progress.end();

  predict_protection(looks);
  prediction.legs = legs_of(looks, prediction.alert_limit_m, prediction.route_m);
  LookProbes probes(tiles, frame, options.camera, options.search_m, texture);
  progress.begin("trying remedies", prediction.legs.size(), "legs");
  for (PredictedLeg& leg : prediction.legs) {
    if (leg.beyond_alert_limit) prediction.beyond_m += leg.length_m;
    (leg.verdict == LegVerdict::good   ? prediction.good_m
     : leg.verdict == LegVerdict::fair ? prediction.fair_m
                                       : prediction.poor_m) += leg.length_m;
    progress.advance();
    if (leg.verdict == LegVerdict::good && !leg.beyond_alert_limit) continue;
    leg.reason = looks[leg.first].agl_m > 0 ? reason_of(leg, looks) : "the route meets the ground";
    if (looks[leg.first].agl_m <= 0 || (leg.verdict == LegVerdict::fair && !leg.beyond_alert_limit)) continue;
    leg.remedies = remedies_for(leg, looks, mission, frame, probes, mission.freshness_days.active);
  }
  progress.end();
  return prediction;
}

}  // namespace nadir
