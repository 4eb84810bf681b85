#include "flight_import/frame_telemetry.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "base/plural.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

// Between the samples of a log that a value is interpolated from.
constexpr double kHeightGap_s = 5, kRangeGap_s = 1, kPositionGap_s = 2;
constexpr double kMaxTilt_rad = 0.785;               // 45 degrees: beyond it a photo is an oblique view
constexpr double kMinFlight_m = 5;                   // lower photos are of the take-off place
constexpr double kMinAgl_m = 1, kMaxAgl_m = 20'000;  // what telemetry.csv may hold

}  // namespace

const char* FrameTelemetry::name_of(AttitudeSource source) {
  switch (source) {
    case AttitudeSource::gimbal: return "the gimbal";
    case AttitudeSource::log: return "the log";
    case AttitudeSource::photo: return "the photos";
    case AttitudeSource::direction: return "the photos' image direction";
  }
  return "";
}

const char* FrameTelemetry::name_of(HeightSource source) {
  switch (source) {
    case HeightSource::stated: return "--agl-m";
    case HeightSource::range: return "range finder";
    case HeightSource::autopilot_terrain: return "the autopilot's terrain";
    case HeightSource::stated_ground: return "above sea level, less --ground-m";
    case HeightSource::terrain_model: return "above sea level or take-off, less --terrain";
    case HeightSource::home: return "above home";
    case HeightSource::take_off: return "above take-off";
  }
  return "";
}

FrameTelemetry::FrameTelemetry(const StatedTelemetry& stated, const FlightLog* log)
    : stated_(stated), log_(log), home_(stated.takeoff) {
  if (!home_ && log_ != nullptr && !log_->positions.empty()) home_ = log_->positions.front().place;
}

bool FrameTelemetry::measure(const PhotoFacts& photo, std::optional<double> log_s, ImportedFrame& frame) {
  const auto attitude_from = set_attitude(photo, log_s, frame);
  const auto height_from = set_height(photo, log_s, frame);
  if (hypotenuse(frame.pitch_rad.value_or(0), frame.roll_rad.value_or(0)) > kMaxTilt_rad) {
    ++oblique_;
    return false;
  }
  if (frame.agl_m && *frame.agl_m < kMinFlight_m) {
    ++on_ground_;
    return false;
  }
  if (frame.agl_m && !(*frame.agl_m >= kMinAgl_m && *frame.agl_m <= kMaxAgl_m)) frame.agl_m.reset();
  if (attitude_from) ++attitude_used_[static_cast<std::size_t>(*attitude_from)];
  if (frame.agl_m && height_from) ++height_used_[static_cast<std::size_t>(*height_from)];
  return true;
}

std::optional<FrameTelemetry::AttitudeSource> FrameTelemetry::set_attitude(const PhotoFacts& facts,
                                                                           std::optional<double> log_s,
                                                                           ImportedFrame& frame) const {
  std::optional<Attitude> camera;
  std::optional<AttitudeSource> from;
  if (facts.gimbal) {
    camera = nadir_attitude_from_gimbal(*facts.gimbal);
    from = AttitudeSource::gimbal;
  } else if (log_s) {
    if (const auto aircraft = attitude_at(log_->attitudes, *log_s, kAttitudeGap_s)) {
      camera = camera_attitude(*aircraft, stated_.mount);
      from = AttitudeSource::log;
    }
  }
  if (!camera && facts.body) {
    camera = facts.body_is_camera ? *facts.body : camera_attitude(*facts.body, stated_.mount);
    from = AttitudeSource::photo;
  }
  if (camera) {
    frame.heading_rad = camera->heading_rad;
    frame.pitch_rad = camera->pitch_rad;
    frame.roll_rad = camera->roll_rad;
  } else if (facts.image_direction_rad) {
    frame.heading_rad = facts.image_direction_rad;
    from = AttitudeSource::direction;
  }
  return from;
}

std::optional<double> FrameTelemetry::ground_at(const std::optional<LonLat>& place) const {
  return place && stated_.ground_height_m ? stated_.ground_height_m(*place) : std::nullopt;
}

std::optional<FrameTelemetry::HeightSource> FrameTelemetry::set_height(const PhotoFacts& facts,
                                                                       std::optional<double> log_s,
                                                                       ImportedFrame& frame) {
  if (stated_.agl_m) {
    frame.agl_m = stated_.agl_m;
    return HeightSource::stated;
  }
  std::optional<double> above_home_m, msl_m;
  std::optional<LonLat> place = facts.gps;
  if (log_s) {
    if (const auto range_m = height_at(log_->ranges, *log_s, kRangeGap_s)) {
      const auto aircraft = attitude_at(log_->attitudes, *log_s, kAttitudeGap_s);
      frame.agl_m = aircraft ? *range_m * std::cos(aircraft->pitch_rad) * std::cos(aircraft->roll_rad) : *range_m;
      return HeightSource::range;
    }
    if (const auto above_m = height_at(log_->terrain_heights, *log_s, kHeightGap_s)) {
      frame.agl_m = above_m;
      return HeightSource::autopilot_terrain;
    }
    above_home_m = height_at(log_->home_heights, *log_s, kHeightGap_s);
    msl_m = height_at(log_->msl_heights, *log_s, kHeightGap_s);
    if (const auto position = position_at(log_->positions, *log_s, kPositionGap_s)) {
      place = position->place;
      if (!msl_m) msl_m = position->msl_m;
    }
  }
  const bool from_photo = !above_home_m && facts.relative_altitude_m;
  if (!above_home_m) above_home_m = facts.relative_altitude_m;
  if (!msl_m) msl_m = facts.absolute_altitude_m;
  if (stated_.ground_m && msl_m) {
    frame.agl_m = *msl_m - *stated_.ground_m;
    return HeightSource::stated_ground;
  }
  if (const auto ground_m = ground_at(place)) {
    const auto home_ground_m = ground_at(home_);
    if (above_home_m && home_ground_m) {
      frame.agl_m = *above_home_m + *home_ground_m - *ground_m;
      return HeightSource::terrain_model;
    }
    if (msl_m) {
      frame.agl_m = *msl_m - *ground_m;
      absolute_used_ = true;
      return HeightSource::terrain_model;
    }
  }
  if (!above_home_m) return std::nullopt;
  frame.agl_m = above_home_m;
  return from_photo ? HeightSource::take_off : HeightSource::home;
}

void FrameTelemetry::set_truth(const PhotoFacts& facts, std::optional<double> log_s, ImportedFrame& frame) const {
  if (log_s) {
    if (const auto position = position_at(log_->positions, *log_s, kPositionGap_s)) {
      frame.place = position->place;
      frame.alt_m = position->msl_m;
      return;
    }
  }
  frame.place = facts.gps;
  frame.alt_m = facts.absolute_altitude_m;
}

TelemetryUncertainty FrameTelemetry::uncertainty(const std::vector<ImportedFrame>& frames) const {
  TelemetryUncertainty uncertainty;
  const bool gimbal = used(AttitudeSource::gimbal) > 0, log = used(AttitudeSource::log) > 0;
  const bool any_heading = std::any_of(frames.begin(), frames.end(), [](const auto& one) { return one.heading_rad; });
  uncertainty.heading_rad = radians(gimbal || log ? 3.0 : any_heading ? 6.0 : 10.0);
  uncertainty.tilt_rad = radians(gimbal ? 1.0 : log ? 2.0 : 5.0);
  const bool flat = used(HeightSource::home) > 0 || used(HeightSource::take_off) > 0 ||
                    used(HeightSource::stated) > 0 || used(HeightSource::stated_ground) > 0;
  uncertainty.agl_relative = flat ? 0.1 : 0.05;
  return uncertainty;
}

void FrameTelemetry::report(const std::vector<ImportedFrame>& frames, const PhotoSet& set, ImportReport& report) const {
  report_left_out(report);
  report_heights(frames, set, report);
  report_attitudes(frames, report);
}

void FrameTelemetry::report_left_out(ImportReport& report) const {
  if (oblique_ > 0) {
    report.warn("import.oblique", count(oblique_, "photo"), "a camera that looks down",
                "its axis is more than 45° from nadir",
                "they are left out; see --mount-pitch-deg if the camera is mounted tilted");
  }
  if (on_ground_ > 0) {
    report.note("import.on_ground", count(on_ground_, "photo"), "photos of the flight",
                fmt::format("less than {} m above ground", kMinFlight_m), "they are left out");
  }
}

void FrameTelemetry::report_heights(const std::vector<ImportedFrame>& frames, const PhotoSet& set,
                                    ImportReport& report) const {
  std::string sources;
  std::size_t known = 0;
  for (std::size_t i = 0; i < kHeightSources; ++i) {
    if (height_used_[i] == 0) continue;
    known += height_used_[i];
    sources +=
        fmt::format("{}{} ({})", sources.empty() ? "" : ", ", name_of(static_cast<HeightSource>(i)), height_used_[i]);
  }
  report.figure("heights", sources.empty() ? "none" : sources);
  if (frames.empty()) return;
  const std::size_t unknown = frames.size() - known;
  constexpr const char* kFix =
      "--agl-m METRES for all photos, --ground-m METRES of the ground above sea level, or --terrain FILE";
  if (known == 0) {
    const bool absolute = std::any_of(set.photos.begin(), set.photos.end(),
                                      [](const Photo& photo) { return photo.facts.absolute_altitude_m; }) ||
                          (log_ && !log_->msl_heights.empty());
    report.missing("import.height", "a height above ground",
                   absolute ? "heights above sea level or the ellipsoid alone" : "no heights", kFix);
  } else if (unknown > 0) {
    report.warn("import.height", count(unknown, "frame"), "a height above ground", "none",
                std::string("their heights are left empty; ") + kFix);
  }
  const std::size_t flat = used(HeightSource::home) + used(HeightSource::take_off);
  if (flat > 0) {
    report.warn("import.height_flat", count(flat, "frame"), "heights above the ground below",
                fmt::format("heights above {}: assumed that the ground is as high everywhere",
                            used(HeightSource::home) > 0 ? "home" : "the place of take-off"),
                "--terrain FILE with --takeoff LON,LAT where it is hilly, or --ground-m METRES");
  }
  if (used(HeightSource::stated_ground) > 0 || absolute_used_) {
    report.note("import.height_datum", "", "heights above sea level",
                "the photos' or the log's: assumed that they and the ground's have the same zero", "");
  }
  if (used(HeightSource::terrain_model) > 0) {
    report.note("import.terrain_lookup", "--terrain", "",
                "the ground is looked up at the recorded positions, which a flight without GPS lacks", "");
  }
}

void FrameTelemetry::report_attitudes(const std::vector<ImportedFrame>& frames, ImportReport& report) const {
  std::string sources;
  std::size_t known = 0;
  for (std::size_t i = 0; i < kAttitudeSources; ++i) {
    if (attitude_used_[i] == 0) continue;
    known += attitude_used_[i];
    sources += fmt::format("{}{} ({})", sources.empty() ? "" : ", ", name_of(static_cast<AttitudeSource>(i)),
                           attitude_used_[i]);
  }
  report.figure("attitude", sources.empty() ? "none" : sources);
  if (frames.empty()) return;
  if (known < frames.size()) {
    report.warn("import.heading", count(frames.size() - known, "frame"), "a heading",
                "none: localization searches all directions, which takes longer and finds less",
                "--log FILE, if there is one");
  }
  const bool by_aircraft = used(AttitudeSource::log) > 0 || used(AttitudeSource::photo) > 0;
  const Attitude& mount = stated_.mount;
  if (by_aircraft && mount.heading_rad == 0 && mount.pitch_rad == 0 && mount.roll_rad == 0) {
    report.note(
        "import.mount", "", "how the camera is mounted",
        "assumed: it looks straight down, with the top of the image to the nose",
        "--mount-yaw-deg, --mount-pitch-deg, --mount-roll-deg, if not; nadir provision boresight determines them");
  }
}

}  // namespace nadir
