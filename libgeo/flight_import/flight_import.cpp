#include "flight_import/flight_import.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "base/input_file.hpp"
#include "base/plural.hpp"
#include "base/printable.hpp"
#include "base/time.hpp"
#include "base/yaml.hpp"
#include "flight_import/ardupilot_log.hpp"
#include "flight_import/clock_choice.hpp"
#include "flight_import/frame_telemetry.hpp"
#include "flight_import/imported_flight.hpp"
#include "flight_import/mavlink_log.hpp"
#include "flight_import/photo_set.hpp"
#include "flight_import/px4_log.hpp"
#include "flight_import/recording_import.hpp"
#include "flight_import/video_frames.hpp"
#include "replay/inertial_file.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr double kInertialMargin_s = 1;  // before the first frame and after the last: delays are looked for in it

std::string import_json(const ImportResult& result, const ImportReport& report) {
  nlohmann::json document{{"schema", "nadir.flight-import/1"}, {"frames", result.frames}};
  document["found"] = nlohmann::json::object();
  for (const auto& [name, text] : report.figures()) document["found"][name] = text;
  if (result.clock_offset_s) {
    document["clock_offset"] = {{"offset_s", *result.clock_offset_s}, {"from", result.clock_offset_from}};
    if (result.clock_offset_sigma_s) document["clock_offset"]["sigma_s"] = *result.clock_offset_sigma_s;
  }
  if (result.start) document["start"] = {{"lon_deg", result.start->lon_deg}, {"lat_deg", result.start->lat_deg}};
  document["assumed"] = nlohmann::json::array();
  for (const Finding& finding : report.findings().items()) {
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
      : request_(request),
        out_(out),
        progress_(progress),
        stated_{request.mount, request.agl_m, request.ground_m, request.takeoff, request.ground_height_m} {}

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
    if (!report_.findings().has_errors() && frames_.empty()) {
      report_.missing("import.frames", "at least one photo of the flight", "none is left", "see the warnings");
    }
    result_.frames = frames_.size();
    result_.start = request_.start;
    if (!result_.start && request_.truth && !frames_.empty()) result_.start = frames_.front().place;
    if (!report_.findings().has_errors()) {
      write(staging.path());
      staging.commit();
    }
    result_.findings = report_.findings();
    result_.figures = report_.figures();
    return std::move(result_);
  }

 private:
  // ---- photos, with or without a log

  void gather() {
    set_ = gather_photos({request_.photos, request_.model, request_.interval_s}, progress_);
    report_.add(set_.findings);
    const PhotoFacts& first = set_.photos.front().facts;
    report_.figure("photos", fmt::format("{}, {}{}{}×{} pixels", count(set_.photos.size(), "photo"), first.model,
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
    report_.figure("video", fmt::format("{} of {}×{} pixels over {:.0f} s", count(video.frames.size(), "frame"),
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
    report_.figure(
        "log", fmt::format("{}, {:.0f} s, {}", log.format, log.end_s() - log.begin_s(), count(log.records, "record")));
    report_.figure("triggers", std::to_string(log.triggers.size()));
    if (log.damaged > 0 || log.truncated || log.wrong_times > 0) {
      report_.warn(
          "import.log_damaged", request_.log->string(), "an undamaged log",
          fmt::format("{} damaged in {}, {} with impossible times{}", log.damaged, count(log.records, "record"),
                      log.wrong_times, log.truncated ? ", and the log ends within a record" : ""),
          "the rest is used; download the log again if photos are missing from it");
    }
    if (log.restarted) {
      report_.warn("import.log_restarted", request_.log->string(), "one flight",
                   "the autopilot's clock starts again: it was restarted", "what follows is not used; split the log");
    }
    if (log.vehicles > 1) {
      report_.warn("import.log_vehicles", request_.log->string(), "one autopilot", count(log.vehicles, "autopilot"),
                   "the first that speaks is used; give a log of one aircraft if that is another");
    }
  }

  bool time_by_camera() {
    if (!set_.timed) {
      report_.missing("import.time", "times in the photos (DateTimeOriginal)", "none",
                      "--interval-s SECONDS between the photos, or --log FILE with the moments of the triggers");
      return false;
    }
    const auto zone_s = request_.zone_s ? request_.zone_s : set_.zone_s;
    if (!zone_s && !request_.interval_s && !request_.video) {
      report_.note("import.zone", "", "the camera's offset from UTC", "not known: time_s is that of the camera's clock",
                   "--zone-h HOURS, if UTC matters to you");
    }
    for (const Photo& photo : set_.photos) add_frame(photo, photo.camera_s - zone_s.value_or(0), std::nullopt);
    utc_ = zone_s.has_value();
    return true;
  }

  // False when the clock offset is not known.
  bool time_by_log() {
    const auto offset = choose_clock_offset(set_, *log_, request_.log->string(),
                                            {request_.clock_offset_s, request_.zone_s}, report_, progress_);
    if (!offset) return false;
    result_.clock_offset_s = offset->offset_s;
    if (offset->sigma_s > 0) result_.clock_offset_sigma_s = offset->sigma_s;
    result_.clock_offset_from = offset->from;
    const double unix_from_log_s = log_->unix_from_log_s.value_or(0);
    if (set_.timed) {
      report_.figure("clock offset",
                     fmt::format("{:.2f} s{}: {}", offset->offset_s,
                                 offset->sigma_s > 0 ? fmt::format(" ± {:.2f} s", offset->sigma_s) : "", offset->from));
    } else {
      report_.figure("clock offset", offset->from);
    }
    if (!log_->unix_from_log_s) {
      report_.note("import.utc", request_.log->string(), "the date",
                   "not in the log: time_s is that since the autopilot's boot", "");
    } else if (log_->utc_from != "GPS") {
      report_.note("import.utc", request_.log->string(), "UTC from the autopilot's GPS", "UTC of the " + log_->utc_from,
                   "");
    }
    std::size_t outside = 0;
    for (std::size_t i = 0; i < set_.photos.size(); ++i) {
      const bool triggered = i < offset->triggers.size() && offset->triggers[i];
      const double log_s =
          triggered ? log_->triggers[*offset->triggers[i]].time_s : set_.photos[i].camera_s + offset->offset_s;
      if (log_s < log_->begin_s() - kAttitudeGap_s || log_s > log_->end_s() + kAttitudeGap_s) {
        ++outside;
        continue;
      }
      add_frame(set_.photos[i], log_s + unix_from_log_s, log_s);
    }
    if (outside > 0) {
      report_.warn("import.outside_log", count(outside, "photo"), "times within the log",
                   fmt::format("before its begin or after its end, at an offset of {:.2f} s", offset->offset_s),
                   "they are left out; if the offset is wrong, state it: --clock-offset-s SECONDS");
    }
    return true;
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
        report_.missing("import.camera_size",
                        fmt::format("photos of {}×{} pixels, as {} says", file.camera.width, file.camera.height,
                                    request_.camera->string()),
                        fmt::format("{}×{} pixels", size.width, size.height), "--camera FILE.yaml of these photos");
      }
      camera_text_ = read_text_file(*request_.camera);
      report_.figure("camera", "from " + request_.camera->string());
      return;
    }
    for (const Photo& photo : set_.photos) {
      draft_ = draft_camera(photo.facts, request_.lens);
      if (draft_) break;
    }
    if (!draft_) {
      const PhotoFacts& facts = set_.photos.front().facts;
      report_.missing("import.focal_length", "a focal length in pixels, or in mm with the width of the sensor",
                      facts.focal_mm ? fmt::format("{} mm, and the sensor of \"{}\" is not in the table of cameras",
                                                   *facts.focal_mm, facts.model)
                                     : std::string("none in the photos"),
                      "--focal-px PIXELS, or --focal-mm MM with --sensor-width-mm MM, or --camera FILE.yaml");
      return;
    }
    if (draft_->disagreement) {
      report_.warn("import.camera_doubt", draft_->from, "the focal length for 35 mm film in the photos",
                   fmt::format("it is {:.2f} times this one", *draft_->disagreement),
                   "--focal-px PIXELS, if you know it; nadir provision camera calibrates");
    }
    report_.figure("camera", fmt::format("a draft, fx {:.1f} px: {}", draft_->camera.fx, draft_->from));
  }

  // Of a draft, when it is known where the telemetry comes from.
  std::string drafted_camera() {
    const TelemetryUncertainty uncertainty = telemetry_->uncertainty(frames_);
    const PhotoFacts& facts = set_.photos.front().facts;
    const std::string taken_with = facts.model.empty() ? "without a camera's name" : "of a " + facts.model;
    std::string text = draft_yaml(*draft_, uncertainty, taken_with);
    try {
      read_camera(YamlNode::parse(text, "camera.yaml"));
    } catch (const UsageError& error) {
      draft_->camera.distortion = {};
      report_.warn("import.distortion", "the maker's calibration in the photos", "a distortion that can be inverted",
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
    telemetry_.emplace(stated_, log_ ? &*log_ : nullptr);
    std::vector<ImportedFrame> kept;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      const auto& [photo, log_s] = sources_[i];
      if (!telemetry_->measure(photo->facts, log_s, frames_[i])) continue;
      if (request_.truth) telemetry_->set_truth(photo->facts, log_s, frames_[i]);
      kept.push_back(std::move(frames_[i]));
    }
    frames_ = std::move(kept);
    std::stable_sort(frames_.begin(), frames_.end(),
                     [](const ImportedFrame& a, const ImportedFrame& b) { return a.time_s < b.time_s; });
    for (std::size_t i = 1; i < frames_.size(); ++i) {
      frames_[i].time_s = std::max(frames_[i].time_s, frames_[i - 1].time_s + kMinFrameStep_s);
    }
    telemetry_->report(frames_, set_, report_);
    if (log_ && !telemetry_->on_gimbal()) take_inertial();
    if (!frames_.empty()) {
      report_.figure("time",
                     fmt::format("{} to {}, {:.0f} s", text_of_time(frames_.front().time_s),
                                 text_of_time(frames_.back().time_s), frames_.back().time_s - frames_.front().time_s));
    }
    if (request_.truth) {
      const auto with = std::count_if(frames_.begin(), frames_.end(), [](const auto& one) { return one.place; });
      report_.figure("truth", fmt::format("{} of {}", with, count(frames_.size(), "frame")));
      if (with == 0) {
        report_.warn("import.truth", "--truth", "GPS positions in the photos or the log", "none",
                     "no truth.csv is written");
      }
    }
  }

  // Of the time of the frames, in the camera's axes.
  void take_inertial() {
    if (frames_.empty()) return;
    const double time_from_log_s = log_->unix_from_log_s.value_or(0);
    const double from_s = frames_.front().time_s - kInertialMargin_s, to_s = frames_.back().time_s + kInertialMargin_s;
    for (InertialSample sample : log_->inertial) {
      sample.time_s += time_from_log_s;
      if (sample.time_s < from_s || sample.time_s > to_s) continue;
      sample.rate_rad_s = camera_rate(sample.rate_rad_s, request_.mount);
      sample.force_mps2 = camera_rate(sample.force_mps2, request_.mount);
      inertial_.push_back(sample);
    }
    if (inertial_.empty()) return;
    if (!close_enough(inertial_)) {
      report_.note("import.inertial", request_.log->string(), "samples of the inertial sensor, 100 a second",
                   fmt::format("{} in {:.0f} s", inertial_.size(), to_s - from_s),
                   "they are left out; the autopilot's own log has more than a ground station's");
      inertial_.clear();
      return;
    }
    report_.figure("inertial", count(inertial_.size(), "sample"));
    for (ImportedFrame& frame : frames_) frame.rate_rad_s = rate_at(frame.time_s);
  }

  // The camera's turn, of the sample whose time holds the moment.
  std::optional<Eigen::Vector3d> rate_at(double time_s) const {
    const auto at = std::ranges::lower_bound(inertial_, time_s, {}, &InertialSample::time_s);
    if (at == inertial_.end() || at->time_s > time_s + parameters::inertial::kMaxGap_s) return std::nullopt;
    return at->rate_rad_s;
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
    inertial_ = std::move(recording.inertial);
    camera_text_ = std::move(recording.camera_yaml);
    report_.add(recording.findings);
    result_.start = recording.start;
    report_.figure("recording", recording.text);
  }

  // ---- output

  void write(const fs::path& folder) {
    const FrameOrigin origin = unpacked_                                  ? FrameOrigin::unpacked
                               : request_.transfer == FrameTransfer::copy ? FrameOrigin::copied
                                                                          : FrameOrigin::linked;
    write_frames(frames_, origin, folder / "frames", progress_);
    write_file_atomic(folder / "telemetry.csv", telemetry_csv(frames_));
    if (close_enough(inertial_)) write_file_atomic(folder / kInertialFile, inertial_csv(inertial_));
    write_file_atomic(folder / "camera.yaml", camera_text_.empty() ? drafted_camera() : camera_text_);
    const bool truth = std::any_of(frames_.begin(), frames_.end(), [](const auto& one) { return one.place; });
    if (truth) write_file_atomic(folder / "truth.csv", truth_csv(frames_));
    write_file_atomic(folder / "import.json", import_json(result_, report_));
  }

  const ImportRequest& request_;
  const fs::path& out_;
  Progress& progress_;
  ImportResult result_;
  ImportReport report_;
  PhotoSet set_;
  std::optional<FlightLog> log_;
  std::optional<CameraDraft> draft_;
  std::string camera_text_;
  std::vector<ImportedFrame> frames_;
  std::vector<FrameSource> sources_;  // of frames_, until telemetry is taken
  std::vector<InertialSample> inertial_;
  StatedTelemetry stated_;
  std::optional<FrameTelemetry> telemetry_;
  bool utc_ = true;        // times are UTC, not those of an unknown zone
  bool unpacked_ = false;  // the frames lie in the new folder already
};

}  // namespace

ImportResult import_flight(const ImportRequest& request, const fs::path& out, Progress& progress) {
  return FlightImporter(request, out, progress).run();
}

}  // namespace nadir
