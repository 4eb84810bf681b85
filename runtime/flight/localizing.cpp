#include "flight/localizing.hpp"

#include <exception>

#include "base/error.hpp"
#include "base/thread_rank.hpp"
#include "estimation/localizer.hpp"
#include "vision/flight_picture.hpp"

namespace nadir {
namespace {

constexpr std::chrono::milliseconds kLookForFinished{20};  // how long a finished look at the map may lie about
constexpr double kFollowerLimit_s = 3;
// A search of all the area by a computer that is slow and has much else to do. Whoever ends it sooner begins it anew.
constexpr double kLookerLimit_s = 120;
constexpr double kLeastHeight_m = 1;
constexpr double kUnderground_m = 10;  // where terrain and barometer may have an aircraft that stands
constexpr double kAutopilotSpeaksWithin_s = 3;

CameraFile decoded_small(CameraFile file, int shrink) {
  file.camera = file.camera.scaled(1.0 / shrink);
  return file;
}

}  // namespace

LocalizationThread::LocalizationThread(const LocalizingSetup& setup, LatestMailbox<FlightPicture>& pictures, ThreadWatch& watch,
                       Listener listener)
    : setup_(setup),
      shrink_(harmless_shrink(setup.camera.camera.width, setup.camera.camera.height)),
      decoded_(setup.camera.camera.scaled(1.0 / shrink_)),
      pictures_(pictures),
      listener_(std::move(listener)),
      telemetry_(setup.mount),
      localizer_(decoded_small(setup.camera, shrink_), setup.frame, setup.tiles, setup.start, setup.config),
      follower_beat_(watch.watch("localizer", kFollowerLimit_s)),
      looker_beat_(watch.watch("map", kLookerLimit_s)),
      looker_([this](const std::stop_token& stop) { look_at_map(stop); }),
      follower_([this](const std::stop_token& stop) { follow_pictures(stop); }) {}

LocalizationThread::~LocalizationThread() { request_stop(); }  // and both threads are waited for

void LocalizationThread::request_stop() {
  follower_.request_stop();
  looker_.request_stop();
}

void LocalizationThread::hint(const LonLat& at, double radius_m, const std::string& by) { hints_.put({0, at, radius_m, by}); }

void LocalizationThread::follow_pictures(const std::stop_token& stop) {
  begin_thread("localizer", ThreadPriority::beside);
  while (!stop.stop_requested()) {
    follower_beat_();
    take_finished();
    take_hint();
    if (const auto picture = pictures_.take_within(kLookForFinished, stop)) follow(*picture);
  }
}

void LocalizationThread::look_at_map(const std::stop_token& stop) {
  begin_thread("map", ThreadPriority::behind);
  const Cancel cancel([this, stop] { return stop.stop_requested() || give_up_; });
  while (!stop.stop_requested()) {
    looker_beat_();
    auto job = jobs_.take_within(std::chrono::milliseconds(500), stop);
    if (!job) continue;
    try {
      (*job)->run(cancel);
    } catch (const std::exception&) {
      // A look that was given up or that fails (a tile that cannot be read, OpenCV at its wits' end) says nothing,
      // whatever it threw: the job goes back as one that never ran.
    }
    if (stop.stop_requested()) return;
    finished_.put(std::move(*job));
  }
}

void LocalizationThread::follow(const FlightPicture& picture) {
  const Telemetry told = telemetry_at(picture);
  if (too_early(picture, told)) return;
  listener_.input(next_index_, told, picture.encoded);
  auto followed = localizer_.track(decode_flight_picture(picture.encoded, decoded_, shrink_), told);
  if (followed.job) {
    job_index_ = next_index_;
    everywhere_ = followed.job->searches_everywhere;
    give_up_ = false;
    jobs_.put(std::move(followed.job));
  }
  const Estimate& estimate = followed.report.estimate;
  if (estimate.position) {
    const Enu at = setup_.frame.enu_from_lonlat(*estimate.position);
    believed_at_ = {at.east_m, at.north_m};
    ground_hinted_ = false;
  }
  placed_ = estimate.position.has_value();
  last_told_ = told;
  last_odometry_ = followed.report.odometry;
  listener_.output({next_index_, next_index_, false, told, std::move(followed.report)});
  ++next_index_;
}

// The first look at the map takes many times as long where any heading is possible, and nothing else is looked up
// meanwhile. After a start in flight the autopilot is heard a second after the first picture.
bool LocalizationThread::too_early(const FlightPicture& picture, const Telemetry& told) {
  if (!first_taken_s_) first_taken_s_ = picture.taken_s;
  return next_index_ == 0 && !told.heading_rad && picture.taken_s - *first_taken_s_ < kAutopilotSpeaksWithin_s;
}

void LocalizationThread::take_finished() {
  auto job = finished_.try_take();
  if (!job) return;
  everywhere_ = false;
  FrameReport report = localizer_.finish(std::move(*job));
  report.odometry = last_odometry_;
  listener_.output({next_index_ - 1, job_index_, true, last_told_, std::move(report)});
}

void LocalizationThread::take_hint() {
  auto hint = hints_.try_take();
  if (!hint) return;
  try {
    localizer_.hint(hint->place, hint->radius_m);
  } catch (const UsageError&) {
    return;
  }
  if (!placed_) {  // the ground under it is that of where it is said to be
    const Enu at = setup_.frame.enu_from_lonlat(hint->place);
    believed_at_ = {at.east_m, at.north_m};
    ground_hinted_ = true;
  }
  if (everywhere_) give_up_ = true;
  hint->before = next_index_;
  listener_.hinted(*hint);
}

// Over terrain the height above ground follows from the height above the sea; a range finder knows better. Where nobody
// said where we are, no height at all does not mean that we stand: it may be another hill.
Telemetry LocalizationThread::telemetry_at(const FlightPicture& picture) {
  const std::scoped_lock lock(telemetry_mutex_);
  Telemetry told = telemetry_.at(picture.taken_s);
  told.frame = picture.name;
  if (told.agl_m) return told;
  std::optional<double> agl_m = telemetry_.above_home_m(picture.taken_s);
  const auto msl_m = telemetry_.msl_m(picture.taken_s);
  const GroundSurface* ground = setup_.config.surface;
  if (ground != nullptr && msl_m) agl_m = *msl_m - setup_.plane_msl_m - ground->height_m(believed_at_);
  const bool stands = ground != nullptr && ground_hinted_ && agl_m && std::abs(*agl_m) < kUnderground_m;
  if (agl_m && *agl_m > kLeastHeight_m) told.agl_m = agl_m;
  if (!told.agl_m && stands) told.agl_m = kLeastHeight_m;
  return told;
}

}  // namespace nadir
