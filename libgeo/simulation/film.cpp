#include "simulation/film.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <utility>

#include "imagery/codecs.hpp"
#include "simulation/delayed_sink.hpp"

namespace nadir {
namespace {

constexpr std::chrono::milliseconds kGlance{100};  // how often `stop` is asked while no pose comes
constexpr double kClockStep_s = 5;                 // more between two poses: somebody set the clock

// When frames are due, on a grid that begins with the first one.
class Shutter {
 public:
  explicit Shutter(double fps) : period_us_(1e6 / fps) {}

  // How many frames have become due up to this time: 0 is "not yet".
  int due(std::int64_t unix_us) {
    const auto now = static_cast<double>(unix_us);
    if (!next_ || std::abs(now - last_pose_us_) > kClockStep_s * 1e6) next_ = now;
    last_pose_us_ = now;
    if (now < *next_) return 0;
    const double periods = std::floor((now - *next_) / period_us_) + 1;
    // On the grid, but never two close together because one came late.
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

CameraSimulationReport film(const LiveCamera& camera, PoseSource& poses, FrameSink& sink, const CameraSimulationOptions& options,
                const std::function<bool()>& stop) {
  CameraSimulationReport report;
  DelayedSink delayed(sink);
  Shutter shutter(options.fps);
  std::int64_t first_us = 0;
  auto heard = std::chrono::steady_clock::now();
  while (!stop()) {
    const std::optional<LivePose> pose = poses.newest(kGlance);
    const auto now = std::chrono::steady_clock::now();
    if (!pose) {
      if (!options.patience || now - heard < *options.patience) continue;
      report.end = CameraSimulationEnd::no_poses;
      break;
    }
    heard = now;
    const int due = shutter.due(pose->unix_us);
    if (due == 0) continue;
    if (report.frames == 0) first_us = pose->unix_us;
    const double begun_s = process_cpu_s();
    const RenderedFrame shot = camera.shoot(*pose, static_cast<std::uint64_t>(report.frames));
    Bytes jpeg = encode_image(shot.image, ImageFormat::jpeg, options.quality);
    const bool late = options.delay.count() > 0 && std::chrono::steady_clock::now() > now + options.delay;
    delayed.put(std::move(jpeg), pose->unix_us, now + options.delay);
    report.cpu_s += process_cpu_s() - begun_s;
    report.frames_late += late ? 1 : 0;
    ++report.frames;
    report.frames_missed += due - 1;
    if (shot.seen_share < 0.999) ++report.frames_beyond_world;
    report.seconds = static_cast<double>(pose->unix_us - first_us) * 1e-6;
    if ((options.max_frames && report.frames >= *options.max_frames) ||
        (options.seconds && report.seconds >= *options.seconds)) {
      report.end = CameraSimulationEnd::all_frames;
      break;
    }
  }
  if (report.end != CameraSimulationEnd::stopped) delayed.finish();
  report.frames = delayed.handed_on();
  return report;
}

}  // namespace nadir
