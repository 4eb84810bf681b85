#include "navigability/look_model.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <opencv2/core.hpp>

#include "base/quantile.hpp"
#include "imagery/map_window.hpp"
#include "navigability/navigability_parameters.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/matching_plan.hpp"

namespace nadir {
using namespace parameters::navigability;
namespace {

constexpr std::size_t kCachedLookTiles = 128;

double map_resolution_m(const TileSource& tiles, const LocalFrame& frame) {
  return ground_resolution_m(tiles.zooms().max, frame.origin().lat_deg);
}

MatchabilityOptions options_at(const CameraModel& camera, double agl_m, double map_gsd_m, double search_m) {
  const double footprint_m = square_footprint_m(camera, agl_m);
  const double gsd_m =
      std::min(matching_scale(camera, agl_m, map_gsd_m).coarse_gsd_m, footprint_m / kLeastFootprint_px);
  return matchability_options(footprint_m, gsd_m, search_m);
}

// By its position in the world, so that a place has the same noise in every prediction.
std::uint64_t number_of(LonLat place, std::uint64_t probe) {
  const auto part = [](double deg) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::llround(deg * 1e5)) & 0x3FFFFFF);
  };
  return part(place.lon_deg) << 32U | part(place.lat_deg) << 6U | probe;
}

}  // namespace

bool is_bare(const ProbedGround& look) {
  return look.valid >= kMinValidShare && look.log_score <= std::log(kBareScore);
}

double anchor_probability(const ProbedGround& look) {
  if (look.valid < kMinValidShare || is_bare(look)) return 0;
  const double sum =
      kLookOffset + kLookPerRatio * look.ratio + kLookPerLogFootprint * std::log(look.footprint_m / look.map_gsd_m);
  return 1 / (1 + std::exp(-sum));
}

struct LookProbes::Impl {
  Impl(const TileSource& source, const LocalFrame& plane, const CameraModel& model, double radius_m, double texture)
      : frame(plane),
        camera(model),
        search_m(radius_m),
        typical(texture),
        map_gsd_m(map_resolution_m(source, plane)),
        reader(source, kCachedLookTiles) {}

  const LocalFrame& frame;
  const CameraModel& camera;
  double search_m, typical, map_gsd_m;
  MapWindowReader reader;
  std::map<int, MatchabilityProbe> probes;  // by height
};

LookProbes::LookProbes(const TileSource& tiles, const LocalFrame& frame, const CameraModel& camera, double search_m,
                       double typical_texture)
    : impl_(std::make_unique<Impl>(tiles, frame, camera, search_m, typical_texture)) {}
LookProbes::~LookProbes() = default;
LookProbes::LookProbes(LookProbes&&) noexcept = default;

ProbedGround LookProbes::look(LonLat place, double agl_m) {
  const int step = static_cast<int>(std::lround(std::log(std::max(agl_m, 1.0)) / kHeightStep));
  auto found = impl_->probes.find(step);
  if (found == impl_->probes.end()) {
    MatchabilityOptions options =
        options_at(impl_->camera, std::exp(step * kHeightStep), impl_->map_gsd_m, impl_->search_m);
    options.typical_texture = impl_->typical;
    found = impl_->probes.emplace(step, MatchabilityProbe(options)).first;
  }
  const MatchabilityProbe& probe = found->second;
  const PlaneBox box = square_around(impl_->frame.plane_from_lonlat(place), probe.reach_m());
  const MapWindow window = impl_->reader.read(impl_->frame, box, probe.options().gsd_m, Colour::grey);
  ProbedGround features{probe.options().footprint_m, probe.options().gsd_m, impl_->map_gsd_m, 0, 0, 0, 0};
  std::array<std::uint64_t, kProbesPerLook> numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = number_of(place, i);
  for (const PlaceMatchability& one : probe.probe(window, numbers)) {
    features.valid = one.valid;
    features.texture = one.texture;
    features.ratio += one.ratio / kProbesPerLook;
    features.log_score += std::log(std::max(one.score, kLeastLookScore)) / kProbesPerLook;
  }
  return features;
}

double typical_texture(const TileSource& tiles, const LocalFrame& frame, const CameraModel& camera, double agl_m,
                       const std::vector<LonLat>& places) {
  const MatchabilityOptions options = options_at(camera, agl_m, map_resolution_m(tiles, frame), kMatchabilityRadius_m);
  MapWindowReader reader(tiles, kCachedLookTiles);
  std::vector<double> textures;
  for (const LonLat& place : places) {
    const PlaneBox box = square_around(frame.plane_from_lonlat(place), options.footprint_m / 2);
    const MapWindow window = reader.read(frame, box, options.gsd_m, Colour::grey);
    if (cv::countNonZero(window.mask) == 0) continue;
    textures.push_back(MatchabilityProbe::texture_of(window.image, window.mask));
  }
  if (textures.empty()) return 0;
  return median(std::move(textures));
}

}  // namespace nadir
