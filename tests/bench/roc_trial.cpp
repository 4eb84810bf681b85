#include "roc_trial.hpp"

#include <fmt/format.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <sstream>

#include "base/error.hpp"
#include "estimation/anchor_acceptance.hpp"
#include "geodesy/angles.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/noise.hpp"

namespace nadir::bench {
namespace {

constexpr double kClear_m = 60;  // distance of a place outside the searched positions

cv::Mat picture_of(Trial& trial, const Photographer& photographer, const World& world, const CameraPose& truth,
                   Random& random) {
  cv::Mat picture = photographer.photograph(world, truth);
  const CameraFile file = camera_file();
  const CameraSensor sensor({file.camera.width, file.camera.height}, file.camera.fx, trial.index);
  sensor.expose(picture, {{random.normal(0, 0.3), random.normal(0, 0.5)}, random.uniform(0.85, 1.25)}, 0);
  const double kind = random.uniform();
  trial.picture = kind < 0.5 ? "clear" : kind < 0.7 ? "old" : kind < 0.8 ? "clouds" : kind < 0.9 ? "blur" : "night";
  if (trial.picture == "clouds") add_clouds(picture, random.uniform(0.2, 0.8), random);
  if (trial.picture == "blur") cv::GaussianBlur(picture, picture, cv::Size(), random.uniform(2, 6));
  if (trial.picture == "night") make_night(picture, random);
  cv::cvtColor(picture, picture, cv::COLOR_BGR2GRAY);
  return picture;
}

AnchorPrior prior_of(const CameraPose& truth, double radius_m, Random& random) {
  const TelemetryUncertainty sigma = camera_file().uncertainty;
  AnchorPrior prior;
  prior.search.pose = truth;
  prior.search.pose.agl_m *= 1 + random.normal(0, sigma.agl_relative);
  prior.search.pose.attitude.heading_rad += random.normal(0, sigma.heading_rad);
  prior.search.pose.attitude.pitch_rad += random.normal(0, sigma.tilt_rad);
  prior.search.pose.attitude.roll_rad += random.normal(0, sigma.tilt_rad);
  prior.search.radius_m = radius_m;
  prior.search.heading_range_rad = 3 * sigma.heading_rad;
  prior.search.scale_range = 2.5 * sigma.agl_relative;
  prior.heading_sigma_rad = sigma.heading_rad;
  prior.log_agl_sigma = sigma.agl_relative;
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * sigma.tilt_rad * sigma.tilt_rad;
  return prior;
}

// The middle of the searched square, from the true place.
PlanePoint window_middle(const Trial& trial, PlanePoint truth, Random& random) {
  const double r = trial.radius_m;
  if (trial.window != "elsewhere") {
    return {truth.east_m + random.uniform(-0.8, 0.8) * r, truth.north_m + random.uniform(-0.8, 0.8) * r};
  }
  // Towards the middle of the world, where there is map.
  const bool along_east = random.chance(0.5);
  const double away = r + kClear_m + random.uniform(0, 100), aside = random.uniform(-0.8, 0.8) * r;
  const auto inward = [](double from, double by) { return from > 0 ? from - by : from + by; };
  return along_east ? PlanePoint{inward(truth.east_m, away), truth.north_m + aside}
                    : PlanePoint{truth.east_m + aside, inward(truth.north_m, away)};
}

}  // namespace

Trial try_match(const Worlds& worlds, const Photographer& photographer, std::uint64_t base_seed, std::uint64_t index) {
  Random random(hash_of(base_seed, static_cast<std::int64_t>(index), 1));
  Trial trial;
  trial.index = index;
  const double kind = random.uniform();
  trial.window = kind < 0.4 ? "right" : kind < 0.7 ? "elsewhere" : kind < 0.85 ? "mirrored" : "other";
  trial.radius_m = std::array{60, 60, 120, 250}[static_cast<std::size_t>(random.integer(0, 3))];
  const auto w = static_cast<std::size_t>(random.integer(0, static_cast<int>(worlds.all.size()) - 1));
  const World& world = *worlds.all[w];
  CameraPose truth;
  truth.position = {random.uniform(-450, 450), random.uniform(-450, 450)};
  truth.agl_m = random.uniform(150, 260);
  truth.attitude = {random.uniform(-kPi, kPi), random.normal(radians(1.5), radians(3)), random.normal(0, radians(5))};
  const cv::Mat grey = picture_of(trial, photographer, world, truth, random);
  AnchorPrior prior = prior_of(truth, trial.radius_m, random);
  prior.search.pose.position = window_middle(trial, truth.position, random);
  const TileSource& tiles = trial.window == "mirrored" ? world.mirrored_map
                            : trial.window == "other"  ? worlds.neighbour(w).map
                            : trial.picture == "old"   ? *worlds.old_maps[w]
                                                       : world.map;
  const CameraModel camera = camera_file().camera;
  const AnchorMatch match = make_channel_matcher({camera, tiles, frame(), world.terrain})->match(grey, prior);
  trial.ratio = match.search.ratio;
  if (!match.search.places.empty()) trial.score = match.search.places.front().score;
  trial.patches = match.patches;
  trial.frame_share = match.frame_share;
  if (match.solved) {
    trial.inliers = match.solved->inliers;
    trial.residual_px = match.solved->rms_m / match.fine_gsd_m;
    trial.surprise = attitude_deviation_sigmas(*match.solved, prior);
    const PlanePoint at = match.solved->pose.position;
    trial.error_m = distance_m(at, truth.position);
  }
  trial.verdict = name_of(evaluate_anchor(match, prior, {0, trial.radius_m / 3, false}));
  return trial;
}

std::string trial_header(std::uint64_t base_seed, int worlds) {
  return fmt::format(
      "# nadir bench roc, base seed {}, {} "
      "worlds\nindex,window,picture,verdict,radius_m,ratio,score,inliers,patches,frame_share,"
      "residual_px,surprise,error_m\n",
      base_seed, worlds);
}

std::string line(const Trial& t) {
  return fmt::format("{},{},{},{},{:.0f},{:.4f},{:.4f},{},{},{:.3f},{:.3f},{:.3f},{:.2f}\n", t.index, t.window,
                     t.picture, t.verdict, t.radius_m, t.ratio, t.score, t.inliers, t.patches, t.frame_share,
                     t.residual_px, t.surprise, t.error_m);
}

Trial trial_of(const std::string& text) {
  std::istringstream in(text);
  Trial t;
  char comma = 0;
  in >> t.index >> comma;
  std::getline(in, t.window, ',');
  std::getline(in, t.picture, ',');
  std::getline(in, t.verdict, ',');
  in >> t.radius_m >> comma >> t.ratio >> comma >> t.score >> comma >> t.inliers >> comma >> t.patches >> comma >>
      t.frame_share >> comma >> t.residual_px >> comma >> t.surprise >> comma >> t.error_m;
  if (!in) throw Error({.what = "a line of results cannot be read", .found = text});
  return t;
}

}  // namespace nadir::bench
