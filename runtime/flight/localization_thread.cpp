#include "flight/localization_thread.hpp"

#include <exception>

#include "base/error.hpp"
#include "base/platform.hpp"
#include "estimation/localizer.hpp"
#include "service/service_rules.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {
namespace {

constexpr std::chrono::milliseconds kPollFinished{20};  // the longest delay of a finished map match
constexpr double kTrackerLimit_s = 3;
constexpr auto kMaxFrameDecode_ms = static_cast<std::int64_t>(1000 * kMaxFrameDecode_s);
// A search of the whole area on a slow, busy computer. Ended sooner, it would only start again.
constexpr double kMatcherLimit_s = 120;
constexpr double kMinHeight_m = 1;
constexpr double kGroundTolerance_m = 10;  // error of terrain and barometer for an aircraft on the ground
constexpr double kAwaitAttitude_s = 3;     // longest

CameraFile shrunk(CameraFile file, int shrink) {
  file.camera = file.camera.scaled(1.0 / shrink);
  return file;
}

}  // namespace

LocalizationThread::LocalizationThread(const LocalizationSetup& setup, LatestMailbox<CapturedFrame>& frames,
                                       ThreadWatch& watch, Listener listener)
    : setup_(setup),
      shrink_(decode_reduction(setup.camera.camera.width, setup.camera.camera.height)),
      decoded_(setup.camera.camera.scaled(1.0 / shrink_)),
      frames_(frames),
      listener_(std::move(listener)),
      telemetry_(setup.mount, {.gimbal = setup.camera.on_gimbal,
                               .turn_rate = setup.camera.readout.has_value(),
                               .inertial = setup.inertial}),
      localizer_(shrunk(setup.camera, shrink_), setup.frame, setup.tiles, setup.start, setup.config),
      tracker_beat_(watch.watch("localizer", kTrackerLimit_s)),
      matcher_beat_(watch.watch("map", kMatcherLimit_s)),
      matcher_([this](const std::stop_token& stop) { match_to_map(stop); }),
      tracker_([this](const std::stop_token& stop) { track_frames(stop); }) {}

LocalizationThread::~LocalizationThread() { request_stop(); }  // the members then join both threads

void LocalizationThread::request_stop() {
  tracker_.request_stop();
  matcher_.request_stop();
}

void LocalizationThread::hint(const LonLat& at, double radius_m, const std::string& source) {
  hints_.put({0, at, radius_m, source});
}

void LocalizationThread::track_frames(const std::stop_token& stop) {
  begin_thread("localizer", ThreadPriority::normal);
  while (!stop.stop_requested()) {
    tracker_beat_();
    apply_finished_match();
    apply_hint();
    if (const auto frame = frames_.take_within(kPollFinished, stop)) process(*frame);
  }
}

void LocalizationThread::match_to_map(const std::stop_token& stop) {
  begin_thread("map", ThreadPriority::low);
  const Cancel cancel([this, stop] { return stop.stop_requested() || cancel_job_; });
  while (!stop.stop_requested()) {
    matcher_beat_();
    auto job = jobs_.take_within(std::chrono::milliseconds(500), stop);
    if (!job) continue;
    try {
      (*job)->run(cancel);
    } catch (const std::exception& error) {
      // A match that was cancelled or failed (an error in OpenCV, no memory) has no result: the job goes back as one
      // that never ran.
      const bool cancelled = stop.stop_requested() || cancel_job_;
      if (!cancelled && listener_.on_match_failed) listener_.on_match_failed(error.what());
    }
    if (stop.stop_requested()) return;
    finished_.put(std::move(*job));
  }
}

void LocalizationThread::process(const CapturedFrame& frame) {
  const Telemetry telemetry = telemetry_at(frame);
  if (awaits_attitude(frame, telemetry)) return;
  listener_.on_frame(next_index_, telemetry, frame.encoded);
  const cv::Mat image = decode_camera_frame(frame.encoded, decoded_, shrink_, {.limit_ms = kMaxFrameDecode_ms});
  if (image.empty()) ++undecodable_;
  auto followed = localizer_.track(image, telemetry);
  if (followed.job) {
    job_index_ = next_index_;
    searches_everywhere_ = followed.job->searches_everywhere;
    cancel_job_ = false;
    jobs_.put(std::move(followed.job));
  }
  const Estimate& estimate = followed.report.estimate;
  if (estimate.position) {
    position_ = setup_.frame.plane_from_lonlat(*estimate.position);
    position_hinted_ = false;
  }
  has_position_ = estimate.position.has_value();
  last_telemetry_ = telemetry;
  last_odometry_ = followed.report.odometry;
  listener_.on_localized({next_index_, next_index_, false, telemetry, std::move(followed.report)});
  ++next_index_;
}

// The first map match takes many times as long when every heading is possible, and blocks all others. After a start in
// flight the first attitude arrives a second after the first frame.
bool LocalizationThread::awaits_attitude(const CapturedFrame& frame, const Telemetry& telemetry) {
  if (!first_captured_s_) first_captured_s_ = frame.captured_s;
  return next_index_ == 0 && !telemetry.heading_rad && frame.captured_s - *first_captured_s_ < kAwaitAttitude_s;
}

void LocalizationThread::apply_finished_match() {
  auto job = finished_.try_take();
  if (!job) return;
  searches_everywhere_ = false;
  FrameReport report = localizer_.finish(std::move(*job));
  report.odometry = last_odometry_;
  listener_.on_localized({next_index_ - 1, job_index_, true, last_telemetry_, std::move(report)});
}

void LocalizationThread::apply_hint() {
  auto hint = hints_.try_take();
  if (!hint) return;
  try {
    localizer_.hint(hint->place, hint->radius_m);
  } catch (const UsageError&) {
    return;
  }
  if (!has_position_) {  // take the ground height there
    position_ = setup_.frame.plane_from_lonlat(hint->place);
    position_hinted_ = true;
  }
  if (searches_everywhere_) cancel_job_ = true;
  hint->before = next_index_;
  listener_.on_hint(*hint);
}

// Over terrain the height above ground follows from the height above sea level; a range finder is more accurate.
// Without a position hint, a height of zero does not mean that the aircraft is on the ground: it may be over another
// hill.
Telemetry LocalizationThread::telemetry_at(const CapturedFrame& frame) {
  const std::scoped_lock lock(telemetry_mutex_);
  Telemetry telemetry = telemetry_.at(frame.captured_s);
  telemetry.frame = frame.name;
  if (telemetry.agl_m) return telemetry;
  std::optional<double> agl_m = telemetry_.above_home_m(frame.captured_s);
  const auto msl_m = telemetry_.msl_m(frame.captured_s);
  const GroundSurface* ground = setup_.config.surface;
  if (ground != nullptr && msl_m) agl_m = *msl_m - setup_.plane_msl_m - ground->height_m(position_);
  const bool on_ground = ground != nullptr && position_hinted_ && agl_m && std::abs(*agl_m) < kGroundTolerance_m;
  if (agl_m && *agl_m > kMinHeight_m) telemetry.agl_m = agl_m;
  if (!telemetry.agl_m && on_ground) telemetry.agl_m = kMinHeight_m;
  return telemetry;
}

}  // namespace nadir
