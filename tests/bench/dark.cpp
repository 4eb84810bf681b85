// Odometry in the dark: how often it measures a step, how far off that is, and how often it makes one up.
// docs/benchmarks.md.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <Eigen/LU>
#include <algorithm>
#include <iostream>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/quantile.hpp"
#include "cpu_time.hpp"
#include "estimation/odometry_features.hpp"
#include "geodesy/angles.hpp"
#include "safety_camera.hpp"
#include "safety_world.hpp"
#include "simulation/camera_sensor.hpp"
#include "vision/camera_frame.hpp"

using namespace nadir;
using namespace nadir::bench;

namespace {

constexpr double kMost95 = 5.99, kMost999 = 13.8;  // χ² of two degrees of freedom

struct Tally {
  int pairs = 0, by_features = 0;
  double cpu_ms = 0;
  std::vector<double> error_m, normalised;  // of the steps measured

  void add(const std::optional<OdometryStep>& step, const Eigen::Vector2d& truth_m) {
    if (!step) return;
    const Eigen::Vector2d off = step->displacement_m - truth_m;
    error_m.push_back(off.norm());
    normalised.push_back(off.dot(step->covariance_m2.inverse() * off));
  }
  int steps() const { return static_cast<int>(error_m.size()); }
  double share_beyond(double limit) const {
    const auto beyond = std::count_if(normalised.begin(), normalised.end(), [=](double v) { return v > limit; });
    return 100.0 * static_cast<double>(beyond) / std::max(1, steps());
  }
};

void print(const char* name, const Tally& t) {
  std::cout << fmt::format(
      "| {} | {} | {:.1f} % | {:.1f} % | {:.1f}, {:.1f}, {:.1f} m | {:.1f} % | {:.1f} % | {:.0f} ms |\n", name, t.pairs,
      100.0 * t.by_features / std::max(1, t.pairs), 100.0 * t.steps() / std::max(1, t.pairs), quantile(t.error_m, 0.5),
      quantile(t.error_m, 0.95), quantile(t.error_m, 1), t.share_beyond(kMost95), t.share_beyond(kMost999),
      t.cpu_ms / std::max(1, t.pairs));
}

class Photographs {
 public:
  explicit Photographs(std::uint64_t seed)
      : file_(camera_file()),
        photographer_(file_.camera),
        sensor_({file_.camera.width, file_.camera.height}, file_.camera.fx, seed),
        random_(Random(seed).fork("dark")) {}

  Random& random() { return random_; }

  // Of water, fog, snow: nothing but the camera's own picture.
  std::optional<OdometryFrame> take_nothing(const CameraPose& pose) {
    const double level = random_.uniform(30, 220);
    cv::Mat picture(file_.camera.height, file_.camera.width, CV_8UC3, cv::Scalar(level, level, level));
    return finish(picture, pose, {.gain = random_.uniform(0.97, 1.03)}, false);
  }

  // With telemetry as it errs in flight; nothing where nobody would look at the picture.
  std::optional<OdometryFrame> take(const World& world, const CameraPose& pose, bool night, bool mirrored) {
    cv::Mat picture = photographer_.photograph(world, pose);
    if (mirrored) cv::flip(picture, picture, 1);
    return finish(picture, pose, {}, night);
  }

 private:
  static constexpr double kTilt_rad = 0.014;  // 0.8°

  std::optional<OdometryFrame> finish(cv::Mat& picture, const CameraPose& pose, const Exposure& exposure, bool night) {
    sensor_.expose(picture, exposure, number_++);
    if (night) make_night(picture, random_);
    OdometryFrame frame;
    cv::cvtColor(picture, frame.grey, cv::COLOR_BGR2GRAY);
    if (!measure_frame_quality(frame.grey).usable) return std::nullopt;
    frame.camera = file_.camera;
    frame.attitude = pose.attitude;
    frame.attitude.pitch_rad += random_.normal(0, kTilt_rad);
    frame.attitude.roll_rad += random_.normal(0, kTilt_rad);
    frame.agl_m = pose.agl_m * (1 + random_.normal(0, 0.01));
    frame.tilt_sigma_rad = kTilt_rad;
    frame.heading_sigma_rad = kTilt_rad;
    frame.linearization_point.heading_rad = pose.attitude.heading_rad;
    return frame;
  }

  CameraFile file_;
  Photographer photographer_;
  CameraSensor sensor_;
  Random random_;
  std::uint64_t number_ = 0;
};

void compare(const std::optional<OdometryFrame>& before, const std::optional<OdometryFrame>& now,
             const Eigen::Vector2d& truth_m, Tally& tally) {
  if (!before || !now) return;
  ++tally.pairs;
  const OdometryFeatures one = odometry_features(*before), other = odometry_features(*now);
  tally.by_features += measure_motion(one.frame, other.frame, similar_pixels(one, other)).has_value();
  const auto odometry = make_feature_odometry();
  odometry->track(*before);
  const double begin_ms = cpu_ms();
  const auto step = odometry->track(*now);
  tally.cpu_ms += cpu_ms() - begin_ms;
  tally.add(step, truth_m);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Odometry of two frames by day and at night: steps measured, their errors, and steps made up.", "dark");
  std::uint64_t seed = 1;
  int pairs = 400, count = 4;
  app.add_option("--seed", seed, "base seed; from a million on over worlds that nothing was chosen with")
      ->capture_default_str();
  app.add_option("--pairs", pairs, "of frames in each row")->check(CLI::Range(10, 100'000))->capture_default_str();
  app.add_option("--worlds", count, "to fly over")->check(CLI::Range(2, 100))->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const Worlds worlds(count, first_world_of(seed));
  Photographs photographs(seed);
  Photographs waters(seed);  // draws of their own
  Random& random = photographs.random();
  Tally day, night, mirrored, elsewhere, nothing;
  while (night.pairs < pairs || elsewhere.pairs < pairs) {
    const auto number = static_cast<std::size_t>(random.integer(0, count - 1));
    const World &world = *worlds.all[number], &other = worlds.neighbour(number);
    const double course = random.uniform(-kPi, kPi), step_m = random.uniform(15, 45);
    const Eigen::Vector2d truth_m = step_m * Eigen::Vector2d(std::sin(course), std::cos(course));
    const auto tilt = [&] { return random.normal(0, 0.05); };
    CameraPose a{
        {random.uniform(-600, 600), random.uniform(-600, 600)}, random.uniform(150, 260), {course, tilt(), tilt()}};
    CameraPose b{{a.position.east_m + truth_m.x(), a.position.north_m + truth_m.y()},
                 a.agl_m,
                 {course + random.normal(0, 0.05), tilt(), tilt()}};
    const auto now = photographs.take(world, b, true, false);
    if (day.pairs < pairs)
      compare(photographs.take(world, a, false, false), photographs.take(world, b, false, false), truth_m, day);
    if (nothing.pairs < pairs) compare(waters.take_nothing(a), waters.take_nothing(b), truth_m, nothing);
    if (!now) continue;
    compare(photographs.take(world, a, true, false), now, truth_m, night);
    compare(photographs.take(world, a, true, true), now, truth_m, mirrored);
    compare(photographs.take(other, a, true, false), now, truth_m, elsewhere);
  }
  std::cout << "| the frame before | pairs | step by features | step | off by: median, 95 %, most | beyond 95 % "
               "ellipse | beyond 99.9 % | CPU |\n"
            << "|---|---|---|---|---|---|---|---|\n";
  print("by day", day);
  print("at night", night);
  print("at night, mirrored: no step is right", mirrored);
  print("at night, of another world: likewise", elsewhere);
  print("by day, of water: likewise", nothing);
  std::cout << fmt::format("base seed {}, {} worlds\n", seed, count);
}
