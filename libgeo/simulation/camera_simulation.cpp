#include "simulation/camera_simulation.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <ctime>
#include <utility>

#include "imagery/codecs.hpp"
#include "simulation/frame_sink.hpp"
#include "vision/rolling_shutter.hpp"

namespace nadir {
namespace {

constexpr double kMaxPixels = 2.5e8;  // of the world in memory; with its pyramid 1.3 GB
constexpr double kFar_m = 20'000;
const cv::Scalar kGrey(96, 104, 100);

// The finest ground sample distance at which the whole world fits into memory.
double gsd_that_fits(const WorldExtent& extent) {
  double shrink = 1;
  while (static_cast<double>(extent.size.width) * extent.size.height / (shrink * shrink) > kMaxPixels) shrink *= 2;
  return shrink == 1 ? 0 : extent.gsd_m * shrink * 1.01;  // slightly more: distances are measured twice
}

double ground_height_m(const LiveCameraOptions& options, const WorldExtent& extent) {
  return options.dem ? GroundShape::height_at(*options.dem, extent.centre) : options.ground_m;
}

bool finite(const LivePose& pose) {
  return std::isfinite(pose.place.lon_deg) && std::abs(pose.place.lat_deg) <= 90 && std::isfinite(pose.height_m) &&
         std::isfinite(pose.attitude.heading_rad) && std::isfinite(pose.attitude.pitch_rad) &&
         std::isfinite(pose.attitude.roll_rad) && pose.velocity_enu_mps.allFinite() && pose.rate_rad_s.allFinite();
}

}  // namespace

LiveCamera::LiveCamera(const LiveCameraOptions& options) : LiveCamera(options, extent_of_world(options.world)) {}

LiveCamera::LiveCamera(const LiveCameraOptions& options, const WorldExtent& extent)
    : LiveCamera(options, extent, read_camera_file(options.camera)) {}

LiveCamera::LiveCamera(const LiveCameraOptions& options, const WorldExtent& extent, const CameraFile& file)
    : camera_(file.camera),
      readout_(file.readout),
      noise_(options.noise),
      box_(extent.box),
      frame_(extent.centre, ground_height_m(options, extent)),
      world_(options.world, frame_, box_, gsd_that_fits(extent)),
      ground_(options.dem ? GroundShape(*options.dem, frame_, box_) : GroundShape()),
      renderer_(camera_, world_, ground_),
      sensor_({camera_.width, camera_.height}, camera_.fx, options.seed),
      exposure_(camera_, options.seed) {}

RenderedFrame LiveCamera::capture(const LivePose& pose, std::uint64_t number) const {
  RenderedFrame grey{cv::Mat(camera_.height, camera_.width, CV_8UC3, kGrey), 0};
  if (!finite(pose)) return grey;
  const Enu at = frame_.enu_from_geodetic({pose.place, pose.height_m});
  const double ground = ground_.up_m({at.east_m, at.north_m});
  FlightPose flight;
  flight.time_s = static_cast<double>(pose.unix_us) * 1e-6;
  flight.agl_m = std::max(1.0, at.up_m - ground);
  flight.position = {at.east_m, at.north_m, ground + flight.agl_m};
  flight.attitude = pose.attitude;
  flight.velocity_mps = pose.velocity_enu_mps.head<2>();
  const bool far = flight.agl_m > kFar_m || at.east_m < box_.west_m - kFar_m || at.east_m > box_.east_m + kFar_m ||
                   at.north_m < box_.south_m - kFar_m || at.north_m > box_.north_m + kFar_m;
  RenderedFrame rendered = far ? grey : render(flight, pose);
  if (noise_ == SensorNoise::real) sensor_.expose(rendered.image, exposure_.of(flight, number), number);
  return rendered;
}

// Velocity and turn hold during the readout.
RenderedFrame LiveCamera::render(const FlightPose& flight, const LivePose& pose) const {
  if (!readout_) return renderer_.render(flight.position, flight.attitude);
  const Eigen::Matrix3d axes = enu_from_camera(flight.attitude);
  const Eigen::Vector3d rate_rad_s = camera_frame_rate(pose.rate_rad_s);
  return renderer_.render(*readout_, [&](double seconds) {
    const Eigen::AngleAxisd turn(rate_rad_s.norm() * seconds, rate_rad_s.stableNormalized());
    return CameraPlace{flight.position + pose.velocity_enu_mps * seconds, axes * turn.toRotationMatrix()};
  });
}

namespace {

constexpr std::chrono::milliseconds kPosePollInterval{100};  // how often `stop` is polled while no pose arrives
constexpr double kClockStep_s = 5;                           // a larger step between two poses: the clock was set

// When frames are due: a fixed interval from the first one.
class FrameSchedule {
 public:
  explicit FrameSchedule(double fps) : period_us_(1e6 / fps) {}

  // How many frames have become due by this time: 0 is "not yet".
  int due(std::int64_t unix_us) {
    const auto now = static_cast<double>(unix_us);
    if (!next_ || std::abs(now - last_pose_us_) > kClockStep_s * 1e6) next_ = now;
    last_pose_us_ = now;
    if (now < *next_) return 0;
    const double periods = std::floor((now - *next_) / period_us_) + 1;
    // On the grid, but never two close together because one was late.
    next_ = std::max(*next_ + periods * period_us_, now + period_us_ / 2);
    return static_cast<int>(periods);
  }

 private:
  double period_us_;
  std::optional<double> next_;
  double last_pose_us_ = 0;
};

double process_cpu_s() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

}  // namespace

CameraSimulationReport run_camera_simulation(const LiveCamera& camera, PoseSource& poses, FrameSink& sink,
                                             const CameraSimulationOptions& options,
                                             const std::function<bool()>& stop) {
  CameraSimulationReport report;
  DelayedSink delayed(sink);
  FrameSchedule schedule(options.fps);
  std::int64_t first_us = 0;
  auto last_pose_at = std::chrono::steady_clock::now();
  while (!stop()) {
    const std::optional<LivePose> pose = poses.latest(kPosePollInterval);
    const auto now = std::chrono::steady_clock::now();
    if (!pose) {
      if (!options.pose_timeout || now - last_pose_at < *options.pose_timeout) continue;
      report.end = CameraSimulationEnd::no_poses;
      break;
    }
    last_pose_at = now;
    const int due = schedule.due(pose->unix_us);
    if (due == 0) continue;
    if (report.frames == 0) first_us = pose->unix_us;
    const double start_s = process_cpu_s();
    const RenderedFrame frame = camera.capture(*pose, static_cast<std::uint64_t>(report.frames));
    Bytes jpeg = encode_image(frame.image, ImageFormat::jpeg, options.quality);
    const bool late = options.delay.count() > 0 && std::chrono::steady_clock::now() > now + options.delay;
    delayed.put(std::move(jpeg), pose->unix_us, now + options.delay);
    report.cpu_s += process_cpu_s() - start_s;
    report.frames_late += late ? 1 : 0;
    ++report.frames;
    report.frames_missed += due - 1;
    if (frame.covered_fraction < 0.999) ++report.frames_beyond_world;
    report.seconds = static_cast<double>(pose->unix_us - first_us) * 1e-6;
    if ((options.max_frames && report.frames >= *options.max_frames) ||
        (options.seconds && report.seconds >= *options.seconds)) {
      report.end = CameraSimulationEnd::all_frames;
      break;
    }
  }
  if (report.end != CameraSimulationEnd::stopped) delayed.finish();
  report.frames = delayed.delivered();
  return report;
}

}  // namespace nadir
