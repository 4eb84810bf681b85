#include "flight_import/flight_import.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "base/input_file.hpp"
#include "base/plural.hpp"
#include "base/printable.hpp"
#include "base/time.hpp"
#include "base/yaml.hpp"
#include "flight_import/ardupilot_log.hpp"
#include "flight_import/clock_offset.hpp"
#include "flight_import/imported_flight.hpp"
#include "flight_import/mavlink_log.hpp"
#include "flight_import/photo_set.hpp"
#include "flight_import/picture_turns.hpp"
#include "flight_import/px4_log.hpp"
#include "flight_import/recording_import.hpp"
#include "flight_import/video_frames.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

// Between the samples of a log that a value is interpolated from.
constexpr double kAttitudeGap_s = 2, kHeightGap_s = 5, kRangeGap_s = 1, kPositionGap_s = 2;
constexpr double kMaxTilt_rad = 0.785;               // 45 degrees: beyond it a photo is an oblique view
constexpr double kMinFlight_m = 5;                   // lower photos are of the take-off place
constexpr double kMinAgl_m = 1, kMaxAgl_m = 20'000;  // what telemetry.csv may hold

enum class HeightSource { stated, range, autopilot_terrain, stated_ground, terrain_model, home, take_off };
constexpr std::size_t kHeightSources = 7;

const char* name_of_source(HeightSource source) {
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

enum class AttitudeSource { gimbal, log, photo, direction };

std::string import_json(const ImportResult& result) {
  nlohmann::json document{{"schema", "nadir.flight-import/1"}, {"frames", result.frames}};
  document["found"] = nlohmann::json::object();
  for (const auto& [name, text] : result.figures) document["found"][name] = text;
  if (result.clock_offset_s) {
    document["clock_offset"] = {{"offset_s", *result.clock_offset_s}, {"from", result.clock_offset_from}};
    if (result.clock_offset_sigma_s) document["clock_offset"]["sigma_s"] = *result.clock_offset_sigma_s;
  }
  if (result.start) document["start"] = {{"lon_deg", result.start->lon_deg}, {"lat_deg", result.start->lat_deg}};
  document["assumed"] = nlohmann::json::array();
  for (const Finding& finding : result.findings.items()) {
    document["assumed"].push_back({{"code", finding.code},
                                   {"severity", name_of(finding.severity)},
                                   {"where", finding.where},
                                   {"expected", finding.expected},
                                   {"found", finding.found},
                                   {"fix", finding.fix}});
  }
  // Names of files may be no UTF-8.
  return document.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

class FlightImporter {
 public:
  FlightImporter(const ImportRequest& request, const fs::path& out, Progress& progress)
      : request_(request), out_(out), progress_(progress) {}

  ImportResult run() {
    StagingDirectory staging(out_);
    fs::create_directory(staging.path() / "frames");
    if (request_.recording) {
      take_recording(staging.path() / "frames");
    } else {
      if (request_.video) {
        take_video(staging.path() / "frames");
      } else {
        gather();
      }
      take_photos();
    }
    if (!findings_.has_errors() && frames_.empty()) {
      missing("import.frames", "at least one photo of the flight", "none is left", "see the warnings");
    }
    result_.frames = frames_.size();
    result_.start = request_.start;
    if (!result_.start && request_.truth && !frames_.empty()) result_.start = frames_.front().place;
    result_.findings = std::move(findings_);
    if (result_.findings.has_errors()) return std::move(result_);
    write(staging.path());
    staging.commit();
    return std::move(result_);
  }

 private:
  void note(std::string code, std::string where, std::string expected, std::string found, std::string fix) {
    findings_.add(
        {std::move(code), Severity::note, std::move(where), std::move(expected), std::move(found), std::move(fix)});
  }
  void warn(std::string code, std::string where, std::string expected, std::string found, std::string fix) {
    findings_.add(
        {std::move(code), Severity::warning, std::move(where), std::move(expected), std::move(found), std::move(fix)});
  }
  void missing(std::string code, std::string expected, std::string found, std::string fix) {
    findings_.add({std::move(code), Severity::error, {}, std::move(expected), std::move(found), std::move(fix)});
  }
  void figure(std::string name, std::string text) { result_.figures.emplace_back(std::move(name), std::move(text)); }

  // ---- photos, with or without a log

  void gather() {
    set_ = gather_photos({request_.photos, request_.model, request_.interval_s}, progress_);
    findings_.add(set_.findings);
    const PhotoFacts& first = set_.photos.front().facts;
    figure("photos", fmt::format("{}, {}{}{}×{} pixels", count(set_.photos.size(), "photo"), first.model,
                                 first.model.empty() ? "" : ", ", first.size.width, first.size.height));
  }

  void take_video(const fs::path& frames_folder) {
    const VideoFrames video =
        unpack_video({*request_.video, request_.interval_s.value_or(1)}, frames_folder, progress_);
    for (const VideoFrame& frame : video.frames) {
      Photo photo{.facts = {}, .name = frame.name, .camera_s = frame.time_s};
      photo.facts.file = frames_folder / frame.name;
      photo.facts.size = video.size;
      set_.photos.push_back(std::move(photo));
    }
    set_.timed = true;
    set_.step_s = 0;
    unpacked_ = true;
    figure("video", fmt::format("{} of {}×{} pixels over {:.0f} s", count(video.frames.size(), "frame"),
                                video.size.width, video.size.height, video.frames.back().time_s));
  }

  void take_photos() {
    if (request_.log) read_log();
    const bool timed = log_ ? time_by_log() : time_by_camera();
    make_camera();
    if (!timed) return;
    take_telemetry();
  }

  void read_log() {
    LogStream stream{InputFile(*request_.log)};
    if (is_ardupilot_log(stream)) {
      log_ = read_ardupilot_log(stream);
    } else if (is_px4_log(stream)) {
      log_ = read_px4_log(stream);
    } else if (is_mavlink_log(stream)) {
      log_ = read_mavlink_log(stream);
    } else {
      throw UsageError({.what = "this is no log that Nadir reads",
                        .where = request_.log->string(),
                        .expected = "an ArduPilot .BIN, a PX4 .ulg or a MAVLink .tlog",
                        .found = stream.size() == 0 ? "an empty file" : "other bytes",
                        .fix = "a text log (.log) is no .BIN: download the .BIN file"});
    }
    const FlightLog& log = *log_;
    if (log.empty()) {
      throw UsageError({.what = "the log holds no attitude and no heights",
                        .where = request_.log->string(),
                        .expected = "the log of a flight",
                        .found = fmt::format("{} of other kinds ({})", count(log.records, "record"), log.format),
                        .fix = "give the log of this flight; without one leave --log out"});
    }
    figure("log",
           fmt::format("{}, {:.0f} s, {}", log.format, log.end_s() - log.begin_s(), count(log.records, "record")));
    figure("triggers", std::to_string(log.triggers.size()));
    if (log.damaged > 0 || log.truncated || log.wrong_times > 0) {
      warn("import.log_damaged", request_.log->string(), "an undamaged log",
           fmt::format("{} damaged in {}, {} with impossible times{}", log.damaged, count(log.records, "record"),
                       log.wrong_times, log.truncated ? ", and the log ends within a record" : ""),
           "the rest is used; download the log again if photos are missing from it");
    }
    if (log.restarted) {
      warn("import.log_restarted", request_.log->string(), "one flight",
           "the autopilot's clock starts again: it was restarted", "what follows is not used; split the log");
    }
    if (log.vehicles > 1) {
      warn("import.log_vehicles", request_.log->string(), "one autopilot", count(log.vehicles, "autopilot"),
           "the first that speaks is used; give a log of one aircraft if that is another");
    }
  }

  bool time_by_camera() {
    if (!set_.timed) {
      missing("import.time", "times in the photos (DateTimeOriginal)", "none",
              "--interval-s SECONDS between the photos, or --log FILE with the moments of the triggers");
      return false;
    }
    const auto zone_s = request_.zone_s ? request_.zone_s : set_.zone_s;
    if (!zone_s && !request_.interval_s && !request_.video) {
      note("import.zone", "", "the camera's offset from UTC", "not known: time_s is that of the camera's clock",
           "--zone-h HOURS, if UTC matters to you");
    }
    for (const Photo& photo : set_.photos) add_frame(photo, photo.camera_s - zone_s.value_or(0), std::nullopt);
    utc_ = zone_s.has_value();
    return true;
  }

  // False when the clock offset is not known.
  bool time_by_log() {
    std::vector<double> times_s;
    for (const Photo& photo : set_.photos) times_s.push_back(photo.camera_s);
    const auto offset = find_offset(times_s);
    if (!offset) return false;
    result_.clock_offset_s = offset->offset_s;
    if (offset->sigma_s > 0) result_.clock_offset_sigma_s = offset->sigma_s;
    result_.clock_offset_from = offset->from;
    const double unix_from_log_s = log_->unix_from_log_s.value_or(0);
    if (set_.timed) {
      figure("clock offset",
             fmt::format("{:.2f} s{}: {}", offset->offset_s,
                         offset->sigma_s > 0 ? fmt::format(" ± {:.2f} s", offset->sigma_s) : "", offset->from));
    } else {
      figure("clock offset", offset->from);
    }
    if (!log_->unix_from_log_s) {
      note("import.utc", request_.log->string(), "the date",
           "not in the log: time_s is that since the autopilot's boot", "");
    } else if (log_->utc_from != "GPS") {
      note("import.utc", request_.log->string(), "UTC from the autopilot's GPS", "UTC of the " + log_->utc_from, "");
    }
    std::size_t outside = 0;
    for (std::size_t i = 0; i < set_.photos.size(); ++i) {
      const bool triggered = i < offset->triggers.size() && offset->triggers[i];
      const double log_s = triggered ? log_->triggers[*offset->triggers[i]].time_s : times_s[i] + offset->offset_s;
      if (log_s < log_->begin_s() - kAttitudeGap_s || log_s > log_->end_s() + kAttitudeGap_s) {
        ++outside;
        continue;
      }
      add_frame(set_.photos[i], log_s + unix_from_log_s, log_s);
    }
    if (outside > 0) {
      warn("import.outside_log", count(outside, "photo"), "times within the log",
           fmt::format("before its begin or after its end, at an offset of {:.2f} s", offset->offset_s),
           "they are left out; if the offset is wrong, state it: --clock-offset-s SECONDS");
    }
    return true;
  }

  std::optional<ClockOffset> find_offset(const std::vector<double>& times_s) {
    const std::string where = request_.log->string();
    const auto zone_s = request_.zone_s ? request_.zone_s : set_.zone_s;
    if (!set_.timed) {
      if (!times_s.empty() && log_->triggers.size() == times_s.size()) {
        ClockOffset offset{.offset_s = log_->triggers.front().time_s,
                           .sigma_s = 0,
                           .supporting = times_s.size(),
                           .from = "as many photos as triggers: one for one, in the order of their names",
                           .triggers = {}};
        for (std::size_t i = 0; i < times_s.size(); ++i) offset.triggers.emplace_back(i);
        note("import.triggers", where, "times in the photos",
             "none: the log's triggers are theirs, in the order of names", "");
        return offset;
      }
      missing("import.clock_offset", "times in the photos, or as many triggers in the log as there are photos",
              fmt::format("no times, and {} for {}", count(log_->triggers.size(), "trigger"),
                          count(times_s.size(), "photo")),
              "--interval-s SECONDS between the photos together with --clock-offset-s SECONDS of the first one");
      return std::nullopt;
    }
    if (request_.clock_offset_s) {
      return ClockOffset{*request_.clock_offset_s, 0, 0, "stated with --clock-offset-s", {}};
    }
    std::optional<double> utc_s;
    if (zone_s && log_->unix_from_log_s) utc_s = -*zone_s - *log_->unix_from_log_s;
    ClockOffsetResult by_triggers = offset_from_triggers(times_s, set_.step_s, log_->triggers, utc_s);
    if (!by_triggers.offset && utc_s) {  // the zone may be wrong
      by_triggers = offset_from_triggers(times_s, set_.step_s, log_->triggers, std::nullopt);
    }
    if (by_triggers.offset) return by_triggers.offset;
    const bool utc_is_exact = utc_s && !request_.zone_s && set_.zone_sigma_s <= 1;
    std::optional<ClockOffset> by_utc;
    if (utc_s) {
      const double sigma_s = request_.zone_s ? 2 : set_.zone_sigma_s;
      by_utc = ClockOffset{*utc_s,
                           std::hypot(sigma_s, 0.3),
                           0,
                           "UTC of both: " + (request_.zone_s ? std::string("--zone-h") : set_.zone_from),
                           {}};
      if (utc_is_exact) return by_utc;
    }
    std::vector<TimedPicture> pictures;
    for (const Photo& photo : set_.photos) pictures.push_back({photo.facts.file, photo.camera_s});
    const ClockOffsetResult by_turns = offset_from_turns(seen_turns(pictures, progress_), set_.step_s, log_->attitudes);
    if (by_turns.offset) {
      if (by_utc && std::abs(by_turns.offset->offset_s - by_utc->offset_s) > 60) {
        warn("import.clock_disagreement", where, fmt::format("about {:.1f} s by UTC", by_utc->offset_s),
             fmt::format("{:.1f} s by the turns in the pictures", by_turns.offset->offset_s),
             "the turns decide; check the camera's clock and its zone, or state --clock-offset-s SECONDS");
      }
      return by_turns.offset;
    }
    if (by_utc) {
      warn("import.clock_offset", where, "triggers or turns that tell the offset",
           fmt::format("UTC alone, good to {:.0f} s; {}; {}", by_utc->sigma_s, by_triggers.why_not, by_turns.why_not),
           "--clock-offset-s SECONDS, if you know it better");
      return by_utc;
    }
    missing("import.clock_offset", "the offset between the clocks of camera and log",
            fmt::format("triggers: {}. UTC: {}. Turns: {}", by_triggers.why_not,
                        zone_s ? "the log does not know the date" : "the photos do not say their offset from it",
                        by_turns.why_not),
            "--clock-offset-s SECONDS (log time less camera time), or --zone-h HOURS of the camera's clock");
    return std::nullopt;
  }

  void add_frame(const Photo& photo, double time_s, std::optional<double> log_s) {
    ImportedFrame frame;
    frame.file = photo.facts.file;
    frame.name = photo.name;
    frame.time_s = time_s;
    frames_.push_back(std::move(frame));
    sources_.push_back({&photo, log_s});
  }

  // ---- the camera

  void make_camera() {
    if (request_.camera) {
      const CameraFile file = read_camera_file(*request_.camera);
      const FrameSize size = set_.photos.front().facts.size;
      if (file.camera.width != size.width || file.camera.height != size.height) {
        missing("import.camera_size",
                fmt::format("photos of {}×{} pixels, as {} says", file.camera.width, file.camera.height,
                            request_.camera->string()),
                fmt::format("{}×{} pixels", size.width, size.height), "--camera FILE.yaml of these photos");
      }
      camera_text_ = read_text_file(*request_.camera);
      figure("camera", "from " + request_.camera->string());
      return;
    }
    for (const Photo& photo : set_.photos) {
      draft_ = draft_camera(photo.facts, request_.lens);
      if (draft_) break;
    }
    if (!draft_) {
      const PhotoFacts& facts = set_.photos.front().facts;
      missing("import.focal_length", "a focal length in pixels, or in mm with the width of the sensor",
              facts.focal_mm ? fmt::format("{} mm, and the sensor of \"{}\" is not in the table of cameras",
                                           *facts.focal_mm, facts.model)
                             : std::string("none in the photos"),
              "--focal-px PIXELS, or --focal-mm MM with --sensor-width-mm MM, or --camera FILE.yaml");
      return;
    }
    if (draft_->disagreement) {
      warn("import.camera_doubt", draft_->from, "the focal length for 35 mm film in the photos",
           fmt::format("it is {:.2f} times this one", *draft_->disagreement),
           "--focal-px PIXELS, if you know it; nadir provision camera calibrates");
    }
    figure("camera", fmt::format("a draft, fx {:.1f} px: {}", draft_->camera.fx, draft_->from));
  }

  // Of a draft, when it is known where the telemetry comes from.
  std::string drafted_camera() {
    TelemetryUncertainty uncertainty;
    const bool gimbal = attitude_used_[static_cast<std::size_t>(AttitudeSource::gimbal)] > 0;
    const bool log = attitude_used_[static_cast<std::size_t>(AttitudeSource::log)] > 0;
    const bool any_heading =
        std::any_of(frames_.begin(), frames_.end(), [](const auto& one) { return one.heading_rad; });
    uncertainty.heading_rad = radians(gimbal || log ? 3.0 : any_heading ? 6.0 : 10.0);
    uncertainty.tilt_rad = radians(gimbal ? 1.0 : log ? 2.0 : 5.0);
    const auto used = [this](HeightSource source) { return height_used_[static_cast<std::size_t>(source)] > 0; };
    uncertainty.agl_relative = used(HeightSource::home) || used(HeightSource::take_off) || used(HeightSource::stated) ||
                                       used(HeightSource::stated_ground)
                                   ? 0.1
                                   : 0.05;
    const PhotoFacts& facts = set_.photos.front().facts;
    const std::string taken_with = facts.model.empty() ? "without a camera's name" : "of a " + facts.model;
    std::string text = draft_yaml(*draft_, uncertainty, taken_with);
    try {
      read_camera(YamlNode::parse(text, "camera.yaml"));
    } catch (const UsageError& error) {
      draft_->camera.distortion = {};
      warn("import.distortion", "the maker's calibration in the photos", "a distortion that can be inverted",
           error.text().what, "the draft has none: nadir provision camera calibrates");
      text = draft_yaml(*draft_, uncertainty, taken_with);
    }
    return text;
  }

  // ---- telemetry

  struct FrameSource {
    const Photo* photo = nullptr;
    std::optional<double> log_s;
  };

  void take_telemetry() {
    if (log_ && !log_->positions.empty()) home_ = log_->positions.front().place;
    if (request_.takeoff) home_ = request_.takeoff;
    std::size_t oblique = 0, on_ground = 0;
    std::vector<ImportedFrame> kept;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      ImportedFrame& frame = frames_[i];
      const FrameSource& source = sources_[i];
      const auto attitude_from = set_attitude(source, frame);
      const double tilt_rad = std::hypot(frame.pitch_rad.value_or(0), frame.roll_rad.value_or(0));
      const auto height_from = set_height(source, frame);
      set_truth(source, frame);
      if (tilt_rad > kMaxTilt_rad) {
        ++oblique;
      } else if (frame.agl_m && *frame.agl_m < kMinFlight_m) {
        ++on_ground;
      } else {
        if (frame.agl_m && !(*frame.agl_m >= kMinAgl_m && *frame.agl_m <= kMaxAgl_m)) frame.agl_m.reset();
        if (attitude_from) ++attitude_used_[static_cast<std::size_t>(*attitude_from)];
        if (frame.agl_m && height_from) ++height_used_[static_cast<std::size_t>(*height_from)];
        kept.push_back(std::move(frame));
      }
    }
    frames_ = std::move(kept);
    std::stable_sort(frames_.begin(), frames_.end(),
                     [](const ImportedFrame& a, const ImportedFrame& b) { return a.time_s < b.time_s; });
    for (std::size_t i = 1; i < frames_.size(); ++i) {
      frames_[i].time_s = std::max(frames_[i].time_s, frames_[i - 1].time_s + kMinFrameStep_s);
    }
    if (oblique > 0) {
      warn("import.oblique", count(oblique, "photo"), "a camera that looks down",
           "its axis is more than 45° from nadir",
           "they are left out; see --mount-pitch-deg if the camera is mounted tilted");
    }
    if (on_ground > 0) {
      note("import.on_ground", count(on_ground, "photo"), "photos of the flight",
           fmt::format("less than {} m above ground", kMinFlight_m), "they are left out");
    }
    report_heights();
    report_attitudes();
    if (!frames_.empty()) {
      figure("time", fmt::format("{} to {}, {:.0f} s", text_of_time(frames_.front().time_s),
                                 text_of_time(frames_.back().time_s), frames_.back().time_s - frames_.front().time_s));
    }
    if (request_.truth) {
      const auto with = std::count_if(frames_.begin(), frames_.end(), [](const auto& one) { return one.place; });
      figure("truth", fmt::format("{} of {}", with, count(frames_.size(), "frame")));
      if (with == 0)
        warn("import.truth", "--truth", "GPS positions in the photos or the log", "none", "no truth.csv is written");
    }
  }

  std::optional<AttitudeSource> set_attitude(const FrameSource& source, ImportedFrame& frame) const {
    const PhotoFacts& facts = source.photo->facts;
    std::optional<Attitude> camera;
    std::optional<AttitudeSource> from;
    if (facts.gimbal) {
      camera = nadir_attitude_from_gimbal(*facts.gimbal);
      from = AttitudeSource::gimbal;
    } else if (source.log_s) {
      if (const auto aircraft = attitude_at(log_->attitudes, *source.log_s, kAttitudeGap_s)) {
        camera = camera_attitude(*aircraft, request_.mount);
        from = AttitudeSource::log;
      }
    }
    if (!camera && facts.body) {
      camera = facts.body_is_camera ? *facts.body : camera_attitude(*facts.body, request_.mount);
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

  std::optional<double> ground_at(const std::optional<LonLat>& place) const {
    return place && request_.ground_height_m ? request_.ground_height_m(*place) : std::nullopt;
  }

  std::optional<HeightSource> set_height(const FrameSource& source, ImportedFrame& frame) {
    if (request_.agl_m) {
      frame.agl_m = request_.agl_m;
      return HeightSource::stated;
    }
    const PhotoFacts& facts = source.photo->facts;
    std::optional<double> above_home_m, msl_m;
    std::optional<LonLat> place = facts.gps;
    if (source.log_s) {
      const double at_s = *source.log_s;
      if (const auto range_m = height_at(log_->ranges, at_s, kRangeGap_s)) {
        const auto aircraft = attitude_at(log_->attitudes, at_s, kAttitudeGap_s);
        frame.agl_m = aircraft ? *range_m * std::cos(aircraft->pitch_rad) * std::cos(aircraft->roll_rad) : *range_m;
        return HeightSource::range;
      }
      if (const auto above_m = height_at(log_->terrain_heights, at_s, kHeightGap_s)) {
        frame.agl_m = above_m;
        return HeightSource::autopilot_terrain;
      }
      above_home_m = height_at(log_->home_heights, at_s, kHeightGap_s);
      msl_m = height_at(log_->msl_heights, at_s, kHeightGap_s);
      if (const auto position = position_at(log_->positions, at_s, kPositionGap_s)) {
        place = position->place;
        if (!msl_m) msl_m = position->msl_m;
      }
    }
    const bool from_photo = !above_home_m && facts.relative_altitude_m;
    if (!above_home_m) above_home_m = facts.relative_altitude_m;
    if (!msl_m) msl_m = facts.absolute_altitude_m;
    if (request_.ground_m && msl_m) {
      frame.agl_m = *msl_m - *request_.ground_m;
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

  void set_truth(const FrameSource& source, ImportedFrame& frame) const {
    if (!request_.truth) return;
    const PhotoFacts& facts = source.photo->facts;
    if (source.log_s) {
      if (const auto position = position_at(log_->positions, *source.log_s, kPositionGap_s)) {
        frame.place = position->place;
        frame.alt_m = position->msl_m;
        return;
      }
    }
    frame.place = facts.gps;
    frame.alt_m = facts.absolute_altitude_m;
  }

  void report_heights() {
    std::string used;
    std::size_t known = 0;
    for (std::size_t i = 0; i < kHeightSources; ++i) {
      if (height_used_[i] == 0) continue;
      known += height_used_[i];
      used += fmt::format("{}{} ({})", used.empty() ? "" : ", ", name_of_source(static_cast<HeightSource>(i)),
                          height_used_[i]);
    }
    figure("heights", used.empty() ? "none" : used);
    if (frames_.empty()) return;
    const std::size_t unknown = frames_.size() - known;
    constexpr const char* kFix =
        "--agl-m METRES for all photos, --ground-m METRES of the ground above sea level, or --terrain FILE";
    if (known == 0) {
      const bool absolute = std::any_of(set_.photos.begin(), set_.photos.end(),
                                        [](const Photo& photo) { return photo.facts.absolute_altitude_m; }) ||
                            (log_ && !log_->msl_heights.empty());
      missing("import.height", "a height above ground",
              absolute ? "heights above sea level or the ellipsoid alone" : "no heights", kFix);
    } else if (unknown > 0) {
      warn("import.height", count(unknown, "frame"), "a height above ground", "none",
           std::string("their heights are left empty; ") + kFix);
    }
    const auto used_from = [this](HeightSource source) { return height_used_[static_cast<std::size_t>(source)]; };
    const std::size_t flat = used_from(HeightSource::home) + used_from(HeightSource::take_off);
    if (flat > 0) {
      warn("import.height_flat", count(flat, "frame"), "heights above the ground below",
           fmt::format("heights above {}: assumed that the ground is as high everywhere",
                       used_from(HeightSource::home) > 0 ? "home" : "the place of take-off"),
           "--terrain FILE with --takeoff LON,LAT where it is hilly, or --ground-m METRES");
    }
    if (used_from(HeightSource::stated_ground) > 0 || absolute_used_) {
      note("import.height_datum", "", "heights above sea level",
           "the photos' or the log's: assumed that they and the ground's have the same zero", "");
    }
    if (used_from(HeightSource::terrain_model) > 0) {
      note("import.terrain_lookup", "--terrain", "",
           "the ground is looked up at the recorded positions, which a flight without GPS lacks", "");
    }
  }

  void report_attitudes() {
    constexpr std::array kNames{"the gimbal", "the log", "the photos", "the photos' image direction"};
    std::string used;
    std::size_t known = 0;
    for (std::size_t i = 0; i < kNames.size(); ++i) {
      if (attitude_used_[i] == 0) continue;
      known += attitude_used_[i];
      used += fmt::format("{}{} ({})", used.empty() ? "" : ", ", kNames[i], attitude_used_[i]);
    }
    figure("attitude", used.empty() ? "none" : used);
    if (frames_.empty()) return;
    if (known < frames_.size()) {
      warn("import.heading", count(frames_.size() - known, "frame"), "a heading",
           "none: localization searches all directions, which takes longer and finds less",
           "--log FILE, if there is one");
    }
    const bool by_aircraft = attitude_used_[static_cast<std::size_t>(AttitudeSource::log)] > 0 ||
                             attitude_used_[static_cast<std::size_t>(AttitudeSource::photo)] > 0;
    const Attitude& mount = request_.mount;
    if (by_aircraft && mount.heading_rad == 0 && mount.pitch_rad == 0 && mount.roll_rad == 0) {
      note("import.mount", "", "how the camera is mounted",
           "assumed: it looks straight down, with the top of the image to the nose",
           "--mount-yaw-deg, --mount-pitch-deg, --mount-roll-deg, if not; nadir provision boresight determines them");
    }
  }

  std::string text_of_time(double time_s) const {
    constexpr double kDates_s = 315'532'800;  // below it, seconds since boot
    if (time_s < kDates_s) return fmt::format("{:.1f} s", time_s);
    std::string text = to_rfc3339(UtcTime{static_cast<std::int64_t>(std::floor(time_s))});
    if (!utc_) text.pop_back();  // of an unknown zone: no Z
    return text;
  }

  // ---- a recording of our own

  void take_recording(const fs::path& frames_folder) {
    std::optional<fs::path> folder;
    if (!request_.photos.empty()) folder = request_.photos.front();
    unpacked_ = !folder;
    ImportedRecording recording =
        import_recording({*request_.recording, request_.session, folder, frames_folder}, request_.truth);
    frames_ = std::move(recording.frames);
    camera_text_ = std::move(recording.camera_yaml);
    findings_.add(recording.findings);
    result_.start = recording.start;
    figure("recording", recording.text);
  }

  // ---- output

  void write(const fs::path& folder) {
    const FrameOrigin origin = unpacked_                                  ? FrameOrigin::unpacked
                               : request_.transfer == FrameTransfer::copy ? FrameOrigin::copied
                                                                          : FrameOrigin::linked;
    write_frames(frames_, origin, folder / "frames", progress_);
    write_file_atomic(folder / "telemetry.csv", telemetry_csv(frames_));
    write_file_atomic(folder / "camera.yaml", camera_text_.empty() ? drafted_camera() : camera_text_);
    const bool truth = std::any_of(frames_.begin(), frames_.end(), [](const auto& one) { return one.place; });
    if (truth) write_file_atomic(folder / "truth.csv", truth_csv(frames_));
    result_.findings.add(findings_);  // of the camera
    write_file_atomic(folder / "import.json", import_json(result_));
  }

  const ImportRequest& request_;
  const fs::path& out_;
  Progress& progress_;
  ImportResult result_;
  Findings findings_;
  PhotoSet set_;
  std::optional<FlightLog> log_;
  std::optional<CameraDraft> draft_;
  std::string camera_text_;
  std::vector<ImportedFrame> frames_;
  std::vector<FrameSource> sources_;  // of frames_, until telemetry is taken
  std::optional<LonLat> home_;
  std::array<std::size_t, kHeightSources> height_used_{};
  std::array<std::size_t, 4> attitude_used_{};
  bool absolute_used_ = false;
  bool utc_ = true;        // times are UTC, not those of an unknown zone
  bool unpacked_ = false;  // the frames lie in the new folder already
};

}  // namespace

ImportResult import_flight(const ImportRequest& request, const fs::path& out, Progress& progress) {
  return FlightImporter(request, out, progress).run();
}

}  // namespace nadir
