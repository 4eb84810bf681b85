#include "tile_trial.hpp"

#include <fmt/format.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <sstream>

#include "estimation/localizer.hpp"
#include "geodesy/web_mercator.hpp"
#include "ortho/candidate_maker.hpp"
#include "simulation/noise.hpp"

namespace nadir::bench {
namespace {

constexpr int kReach_px = 40;        // search radius of a tile: 16 m
constexpr int kPatch_px = 160;       // of the tile's middle
constexpr double kRecognised = 0.5;  // correlation; the correct place has 0.9
constexpr double kSeen_px = 0.5;

PlanePoint place_of(const TileKey& key, double column, double row) {
  const LonLat place = lonlat_from_pixel(
      {static_cast<double>(key.x) * kTileSize + column + 0.5, static_cast<double>(key.y) * kTileSize + row + 0.5},
      key.z);
  return frame().plane_from_lonlat(place);
}

// Where the true camera saw what the tile shows, on the mean over the tile.
double geometric_off_m(const TileKey& key, const CameraModel& camera, const CameraPose& used, const CameraPose& truth,
                       const GroundSurface& surface) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int count = 0;
  for (int r = 16; r < kTileSize; r += 56) {
    for (int c = 16; c < kTileSize; c += 56) {
      const auto pixel = frame_pixel_of(key, c, r, frame(), camera, used, surface);
      if (!pixel) continue;
      const auto seen = ground_from_ray(truth, camera.ray_from_pixel(*pixel), surface);
      if (!seen) continue;
      const PlanePoint claimed = place_of(key, c, r);
      sum += Eigen::Vector2d(seen->east_m - claimed.east_m, seen->north_m - claimed.north_m);
      ++count;
    }
  }
  return count == 0 ? 1e6 : (sum / count).norm();
}

double peak(double before, double at, double after) {
  const double bend = before - 2 * at + after;
  return bend < 0 ? kSeen_px * (before - after) / bend : 0;
}

// The centre of the tile located in the world's raster around its place.
double raster_off_m(const TileKey& key, const cv::Mat& tile, const cv::Mat& day) {
  constexpr int side = kPatch_px + 2 * kReach_px, first = (kTileSize - side) / 2;
  cv::Mat_<cv::Vec2f> from(side, side);
  for (int r = 0; r < side; ++r) {
    for (int c = 0; c < side; ++c) {
      const cv::Point2f pixel(pixel_of(place_of(key, first + c, first + r)));
      from(r, c) = {pixel.x, pixel.y};
    }
  }
  cv::Mat world, grey_world, grey_tile, scores;
  cv::remap(day, world, from, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
  cv::cvtColor(world, grey_world, cv::COLOR_BGR2GRAY);
  constexpr int inset = (kTileSize - kPatch_px) / 2;
  cv::cvtColor(tile(cv::Rect(inset, inset, kPatch_px, kPatch_px)), grey_tile, cv::COLOR_BGR2GRAY);
  cv::matchTemplate(grey_world, grey_tile, scores, cv::TM_CCOEFF_NORMED);
  double best = 0;
  cv::Point at;
  cv::minMaxLoc(scores, nullptr, &best, nullptr, &at);
  if (best < kRecognised) return -1;
  double dx = at.x - kReach_px, dy = at.y - kReach_px;
  const auto score = [&](int x, int y) { return static_cast<double>(scores.at<float>(y, x)); };
  if (at.x > 0 && at.y > 0 && at.x + 1 < scores.cols && at.y + 1 < scores.rows) {
    dx += peak(score(at.x - 1, at.y), best, score(at.x + 1, at.y));
    dy += peak(score(at.x, at.y - 1), best, score(at.x, at.y + 1));
  }
  const PlanePoint here = place_of(key, 128, 128), there = place_of(key, 128 + dx, 128 + dy);
  return distance_m(there, here);
}

}  // namespace

std::string tile_trial_header(std::uint64_t seed, int worlds) {
  return fmt::format("index,condition,frames,anchored,tiles  # seed {} worlds {}\n", seed, worlds);
}

std::string line(const TileTrial& trial) {
  std::string tiles;
  for (const TileOff& t : trial.tiles) {
    tiles += fmt::format("{}{}:{:.3f}:{:.3f}:{:.3f}:{:.3f}", tiles.empty() ? "" : ";", t.refined ? 1 : 0, t.geometric_m,
                         t.raster_m, t.pose_error_m, t.sigma_m);
  }
  return fmt::format("{},{},{},{},{}\n", trial.index, trial.condition, trial.frames, trial.anchored, tiles);
}

TileTrial tile_trial_of(const std::string& text) {
  TileTrial trial;
  std::istringstream in(text);
  std::string cell;
  const auto next = [&] {
    std::getline(in, cell, ',');
    return cell;
  };
  trial.index = std::stoull(next());
  trial.condition = next();
  trial.frames = std::stoi(next());
  trial.anchored = std::stoi(next());
  while (std::getline(in, cell, ';')) {
    TileOff& tile = trial.tiles.emplace_back();
    std::istringstream values(cell);
    std::string value;
    const auto number = [&] {
      std::getline(values, value, ':');
      return std::stod(value);
    };
    tile.refined = number() > 0;
    tile.geometric_m = number(), tile.raster_m = number(), tile.pose_error_m = number(), tile.sigma_m = number();
  }
  return trial;
}

TileTrials::TileTrials(int worlds) : photographer_(camera_file().camera), worlds_(worlds) {}

TileTrial TileTrials::fly(std::uint64_t base_seed, std::uint64_t index) const {
  const Flight flight = make_flight(hash_of(base_seed, static_cast<std::int64_t>(index)), worlds_.all, photographer_);
  const World& world = *worlds_.all[flight.world];
  const Fault fault = flight.condition->fault;
  const PictureTiles shifted(world.satellite, {.shift = flight.shift});
  const JoinedTiles joined(world.map, shifted, flight.border.value_or(Border{}));
  const TileSource* map = &world.map;
  if (fault == Fault::old_map) map = worlds_.old_maps[flight.world].get();
  if (fault == Fault::mirrored_map) map = &world.mirrored_map;
  if (fault == Fault::other_region) map = &worlds_.neighbour(flight.world).map;
  if (fault == Fault::map_shift) map = &shifted;
  if (flight.border) map = &joined;
  Localizer localizer(camera_file(), frame(), map, flight.start, config_of(flight, world));
  CandidateFlight made{.airframe = "bench",
                       .flight = "bench",
                       .base_package = {},
                       .camera = camera_file().camera,
                       .frame = frame(),
                       .surface = &world.terrain,
                       .zoom = kTileTrialZoom};
  made.limits.max_coarseness = 3;  // this camera has 320 pixels across
  const CandidateMaker maker(made);

  TileTrial trial;
  trial.index = index;
  trial.condition = flight.condition->name;
  trial.frames = static_cast<int>(flight.shots.size());
  const auto add = [&](const Shot& shot, const FramePose& pose) {
    if (shot.picture.empty()) return;
    FrameTiles report;
    const Bytes encoded = encode_image(shot.picture, ImageFormat::jpeg, 92);
    for (const auto& tile : maker.raw_tiles({"frame", {}, pose}, encoded, report)) {
      const TileKey& key = tile.sidecar.key;
      trial.tiles.push_back({pose.refined, geometric_off_m(key, made.camera, pose.pose, shot.truth, world.terrain),
                             raster_off_m(key, tile.image, world.day),
                             distance_m(pose.pose.position, shot.truth.position), pose.sigma_m});
    }
  };
  for (const Shot& shot : flight.shots) {
    const FrameReport report = localizer.process(shot.picture, shot.telemetry);
    trial.anchored += report.anchor_pose.has_value();
    if (report.anchor_pose) add(shot, *report.anchor_pose);
  }
  const auto refined = localizer.refined_poses();
  for (std::size_t i = 0; i < refined.size(); ++i) {
    if (refined[i]) add(flight.shots[i], *refined[i]);
  }
  return trial;
}

}  // namespace nadir::bench
