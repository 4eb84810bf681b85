// A flight from pictures, online, smoothed and adjusted, against the truth: 300 frames over a world in memory, along
// four legs with a sharp turn between each two, five pictures of another place, and a fifth of the way without a map.
// And the seams of its orthophoto, by the poses as processed and adjusted, over terrain, level ground and its own
// surface.
//
// Usage: bench_adjusted_flight [SEED [FRAMES [MOSAIC.png]]]    the orthophoto by adjusted poses goes to MOSAIC.png, and
// with the exposures as they were to MOSAIC.png.as-exposed.png
#include <fmt/format.h>
#include <unistd.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/files.hpp"
#include "base/quantile.hpp"
#include "base/random.hpp"
#include "cpu_time.hpp"
#include "flight_adjustment/flight_adjustment.hpp"
#include "flights/flight_engine.hpp"
#include "flights/flight_store.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "ortho/surface_model.hpp"
#include "replay/score.hpp"
#include "safety_camera.hpp"
#include "safety_world.hpp"
#include "seams.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/telemetry_noise.hpp"

namespace nadir::bench {
namespace {

constexpr int kLegs = 4;
constexpr double kStep_m = 18, kSpacing_m = 90, kAgl_m = 160, kInterval_s = 1;
constexpr double kStartSigma_m = 30;
constexpr int kOutliers = 5;
constexpr double kOutlier_m = 350;

// Flown as 0, 2, 1, 3 of parallel legs, without pictures in the turns (half circles at the same speed): after each the
// camera sees another place, the other way around, and neighbouring legs overlap.
std::vector<FlightPose> path(int frames, Random random) {
  constexpr double kRows[kLegs] = {0, 2, 1, 3};
  const int per_leg = frames / kLegs;
  std::vector<FlightPose> poses;
  double roll = 0, pitch = 0, turns_s = 0;
  for (int i = 0; i < frames; ++i) {
    const int leg = std::min(i / per_leg, kLegs - 1), along = i - leg * per_leg;
    const bool east = leg % 2 == 0;
    if (along == 0 && leg > 0) {
      turns_s += kPi / 2 * std::abs(kRows[leg] - kRows[leg - 1]) * kSpacing_m / (kStep_m / kInterval_s);
    }
    FlightPose pose;
    pose.time_s = i * kInterval_s + turns_s;
    const double x = (along - per_leg / 2.0) * kStep_m;
    pose.position.x() = east ? x : -x;
    pose.position.y() = (kRows[leg] - 1.5) * kSpacing_m + 6 * std::sin(0.11 * i);
    pitch = 0.8 * pitch + random.normal(0, radians(0.6));
    roll = 0.8 * roll + random.normal(0, radians(1.2));
    pose.attitude = {radians(east ? 90 : -90) + radians(2) * std::sin(0.07 * i), pitch, roll};
    pose.agl_m = pose.pressure_agl_m = kAgl_m + 4 * std::sin(0.05 * i);
    pose.velocity_mps = {east ? kStep_m : -kStep_m, 0};
    poses.push_back(pose);
  }
  return poses;
}

// The map has a hole: no tiles under a part of the flight.
class HoledMap final : public TileSource {
 public:
  HoledMap(const TileSource& map, double west_m, double east_m) : map_(map), west_m_(west_m), east_m_(east_m) {}
  ZoomRange zooms() const override { return map_.zooms(); }
  std::optional<Bytes> read(const TileKey& key) const override {
    const LonLat middle = lonlat_from_pixel(
        {(static_cast<double>(key.x) + 0.5) * kTileSize, (static_cast<double>(key.y) + 0.5) * kTileSize}, key.z);
    const PlanePoint at = frame().plane_from_lonlat(middle);
    return at.east_m > west_m_ && at.east_m < east_m_ ? std::nullopt : map_.read(key);
  }

 private:
  const TileSource& map_;
  double west_m_, east_m_;
};

struct Figures {
  std::vector<double> errors_m;
  std::size_t frames = 0, within_20 = 0;
  double nees = 0;      // of the stated covariance; 2 is right
  double own_nees = 0;  // of the covariance without the map's own error, and without the offset that all frames share
  Eigen::Vector2d offset_m = Eigen::Vector2d::Zero();  // … their mean error
};

Figures figures(const std::vector<Estimate>& estimates, const std::vector<FlightPose>& truth,
                const std::vector<bool>& outlier, const std::vector<SmoothedFrame>& smoothed) {
  Figures result;
  std::vector<std::pair<std::size_t, Eigen::Vector2d>> judged;
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    ++result.frames;
    if (!estimates[i].position) continue;
    const Eigen::Vector2d off =
        frame().plane_from_lonlat(*estimates[i].position).vector() - truth[i].position.head<2>();
    result.errors_m.push_back(off.norm());
    result.within_20 += off.norm() < 20 ? 1U : 0U;
    if (!outlier[i]) judged.emplace_back(i, off);
  }
  const auto count = static_cast<double>(judged.size());
  for (const auto& [i, off] : judged) result.offset_m += off / count;
  for (const auto& [i, off] : judged) {
    result.nees += off.dot(estimates[i].covariance_m2.inverse() * off) / count;
    const Eigen::Matrix2d own_m2 = estimates[i].covariance_m2 - smoothed[i].shared_m2;
    const Eigen::Vector2d own = off - result.offset_m;
    if (own_m2.determinant() > 0) result.own_nees += own.dot(own_m2.inverse() * own) / count;
  }
  return result;
}

nlohmann::json json_from(const Figures& f) {
  double squares = 0;
  for (const double error_m : f.errors_m) squares += error_m * error_m;
  return {{"positions", f.errors_m.size()},
          {"median_m", quantile(f.errors_m, 0.5)},
          {"rms_m", std::sqrt(squares / static_cast<double>(f.errors_m.size()))},
          {"p95_m", quantile(f.errors_m, 0.95)},
          {"max_m", quantile(f.errors_m, 1)},
          {"within_20_m_share", static_cast<double>(f.within_20) / static_cast<double>(f.frames)},
          {"nees", f.nees},
          {"offset_m", {f.offset_m.x(), f.offset_m.y()}},
          {"nees_without_map_error", f.own_nees}};
}

// What a map without an elevation model says of the ground.
class LevelGround final : public GroundSurface {
 public:
  explicit LevelGround(double height_m) : height_m_(height_m) {}
  double height_m(PlanePoint) const override { return height_m_; }
  double relief_sigma_m() const override { return 0; }

 private:
  double height_m_;
};

FramePoses over(const GroundSurface& surface, const GroundSurface& terrain, FramePoses poses) {
  for (auto& pose : poses) {
    if (pose) pose->agl_m += terrain.height_m(pose->position) - surface.height_m(pose->position);
  }
  return poses;
}

// Of the frames that have a position: as processed, and adjusted over the terrain, over level ground, and over the
// shape of the ground that the pictures show where no terrain is known. No picture of another place is part of it.
nlohmann::json seams_of(const FlightStore& store, const FlightToAdjust& flight, const AdjustedFlight& adjusted,
                        const std::vector<bool>& outlier, const GroundSurface& terrain, const std::string& mosaic) {
  FramePoses online(outlier.size()), after(outlier.size());
  const auto estimates = store.estimates(EstimateKind::online);
  for (std::size_t i = 0; i < outlier.size(); ++i) {
    if (outlier[i]) continue;
    const StateEstimate state = store.stored_frame(i).online.state;
    const Telemetry& telemetry = flight.telemetry[i];
    if (estimates[i].position) {
      online[i] = {flight.plane.plane_from_lonlat(*estimates[i].position),
                   state.agl_m,
                   {state.heading_rad, telemetry.pitch_rad.value_or(0), telemetry.roll_rad.value_or(0)}};
    }
    if (adjusted.estimates[i].position) after[i] = adjusted.block.frames[i].pose;
  }
  const CameraModel camera = adjusted_poses(adjusted).lens.applied_to(flight.camera.camera);
  const LevelGround level(terrain.height_m({0, 0}));
  const FramePoses over_level = over(level, terrain, after);
  NoProgress progress;
  const SurfaceModel shape = surface_from_frames(camera, level, over_level, flight.image_of, progress);
  cv::Mat orthophoto, as_exposed;
  const auto of = [&](const GroundSurface& surface, const FramePoses& poses, const BenchImageOf& image_of,
                      cv::Mat* shown = nullptr) {
    return json_from(seams(camera, flight.plane, surface, poses, image_of, shown));
  };
  const nlohmann::json document{
      {"online", of(terrain, online, flight.image_of)},
      {"adjusted", of(terrain, after, flight.image_of, &as_exposed)},
      {"adjusted_balanced", of(terrain, after, balanced_images(camera, terrain, after, flight.image_of), &orthophoto)},
      {"adjusted_level_ground", of(level, over_level, flight.image_of)},
      {"adjusted_own_surface", of(shape, over(shape, level, over_level), flight.image_of)}};
  if (!mosaic.empty()) {
    write_file_atomic(mosaic, encode_image(orthophoto, ImageFormat::png));
    write_file_atomic(mosaic + ".as-exposed.png", encode_image(as_exposed, ImageFormat::png));
  }
  return document;
}

void run(std::uint64_t seed, int frames, const std::string& mosaic) {
  const World world(seed);
  const CameraFile camera = camera_file();
  const Photographer photographer(camera.camera);
  const CameraSensor sensor({camera.camera.width, camera.camera.height}, camera.camera.fx, seed);
  TelemetryNoise noise(camera.uncertainty, seed);
  const Random base(seed);
  Random light = base.fork("light"), faults = base.fork("faults"), start = base.fork("start");
  const std::vector<FlightPose> truth = path(frames, base.fork("path"));
  const double reach_m = frames / kLegs * kStep_m;
  const HoledMap map(world.map, 0.1 * reach_m, 0.3 * reach_m);  // tiles are 200 m wide: their middles count

  FlightEngineSetup setup{
      .camera = camera,
      .shrink = 1,
      .frame = frame(),
      .tiles = &map,
      .start = frame().lonlat_from_plane({truth.front().position.x() + start.normal(0, kStartSigma_m),
                                          truth.front().position.y() + start.normal(0, kStartSigma_m)}),
      .localizer = {}};
  setup.localizer.start_sigma_m = kStartSigma_m;
  setup.localizer.map_sigma_m = world.map_sigma_m;
  setup.localizer.surface = &world.terrain;
  FlightDescription description;
  description.name = "bench";
  description.session.camera = camera;
  description.session.origin = frame().origin();
  description.session.start = setup.start;
  const auto folder = std::filesystem::temp_directory_path() / fmt::format("bench_adjusted_{}_{}", seed, ::getpid());
  {
    const auto store = FlightStore::create(folder, description, system_clock_millis(),
                                           {.sync = StoreSync::checkpoints, .limits = {}, .outside = {}, .hook = {}});
    std::vector<bool> outlier(truth.size(), false);
    for (std::size_t i = 0; i < truth.size(); ++i) {
      CameraPose seen{PlanePoint(truth[i].position.head<2>()), truth[i].agl_m, truth[i].attitude};
      const std::size_t every = truth.size() / kOutliers;
      outlier[i] = i % every == every / 2;
      if (outlier[i]) {
        const double direction = faults.uniform(-kPi, kPi);
        seen.position = seen.position + kOutlier_m * Eigen::Vector2d(std::sin(direction), std::cos(direction));
      }
      cv::Mat picture = photographer.photograph(world, seen);
      Exposure exposure;
      exposure.gain = light.uniform(0.85, 1.25);
      exposure.motion_px = {light.normal(0, 0.3), light.normal(0, 0.5)};
      sensor.expose(picture, exposure, i);
      const MeasuredPose measured = noise.measure(truth[i]);
      PictureOffer offer;
      const Bytes bytes = encode_image(picture, ImageFormat::png);
      offer.name = offer.telemetry.frame = fmt::format("{:04}.png", i);
      offer.telemetry.time_s = 100 + measured.time_s;
      offer.telemetry.agl_m = measured.agl_m;
      offer.telemetry.heading_rad = measured.attitude.heading_rad;
      offer.telemetry.pitch_rad = measured.attitude.pitch_rad;
      offer.telemetry.roll_rad = measured.attitude.roll_rad;
      offer.bytes = bytes;
      store->accept({&offer, 1}, system_clock_millis());
    }
    FlightEngine engine(*store, setup);
    engine.process();
    const double before_ms = cpu_ms();
    NoProgress progress;
    const FlightToAdjust flight = flight_to_adjust(*store, engine, setup);
    const AdjustedFlight adjusted = adjust_flight(flight, progress);
    const auto online = store->estimates(EstimateKind::online);
    const auto all = [&](const std::vector<Estimate>& estimates) {
      return json_from(figures(estimates, truth, outlier, flight.smoothed));
    };
    const nlohmann::json document{
        {"seed", seed},
        {"frames", truth.size()},
        {"anchored", std::count_if(flight.smoothed.begin(), flight.smoothed.end(),
                                   [](const SmoothedFrame& f) { return f.anchor.has_value(); })},
        {"online", all(online)},
        {"refined", all(flight.refined)},
        {"adjusted", all(adjusted.estimates)},
        {"cpu_s", (cpu_ms() - before_ms) / 1000},
        {"seams", seams_of(*store, flight, adjusted, outlier, world.terrain, mosaic)},
        {"adjustment", nadir::json_from(adjusted.summary)}};
    fmt::print("{}\n", document.dump());
  }
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace nadir::bench

int main(int argc, char** argv) {
  const auto number = [&](int i, int otherwise) { return argc > i ? std::atoi(argv[i]) : otherwise; };
  nadir::bench::run(static_cast<std::uint64_t>(number(1, 1)), number(2, 300), argc > 3 ? argv[3] : "");
}
