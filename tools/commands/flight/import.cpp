// nadir flight import: photos, logs and recordings into a flight that nadir replay reads.
#include "flight_import/flight_import.hpp"

#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "geodesy/angles.hpp"
#include "raster/elevation_model.hpp"

namespace nadir {
namespace {

class FlightImportCommand final : public Command {
 public:
  std::string_view group() const override { return "flight"; }
  std::string_view name() const override { return "import"; }
  std::string_view summary() const override { return "make a flight of photos, an autopilot's log or a recording"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void check() const;
  ImportRequest request() const;

  std::vector<std::filesystem::path> photos_;
  std::optional<std::filesystem::path> video_, log_, recorder_, camera_, terrain_;
  std::optional<std::string> session_;
  std::string model_, frames_ = "link";
  std::optional<double> focal_px_, focal_mm_, sensor_width_mm_;
  double mount_yaw_deg_ = 0, mount_pitch_deg_ = 0, mount_roll_deg_ = 0;
  std::optional<double> agl_m_, ground_m_, clock_offset_s_, zone_h_, interval_s_;
  std::optional<LonLat> start_, takeoff_;
  bool truth_ = false;
  std::filesystem::path out_;
};

std::string_view FlightImportCommand::details() const {
  return R"(OUT receives frames/ (links to the photos, or copies), telemetry.csv, a draft of camera.yaml and
import.json: what nadir replay reads, and what was found and assumed. Sources are never changed.

Sources: photos with EXIF and XMP or a video, alone or with an ArduPilot .BIN, a PX4 .ulg or a
MAVLink .tlog; or a recording of nadird. The offset between the clocks of camera and log is estimated from triggers
in the log, from UTC, or from the turns that the pictures show; --clock-offset-s overrides it.

GPS positions never become telemetry. With --truth they are written to truth.csv, for scoring.

What is assumed is listed with the option that states it. What is missing is asked for, and nothing
is written.

Exit codes: 0 written, 1 something is missing: the findings name the option, 2 a source cannot be
read.)";
}

std::string_view FlightImportCommand::examples() const {
  return R"(nadir flight import --photos DCIM/100MEDIA --truth --out flight
nadir flight import --photos DCIM --log 00000042.BIN --camera camera.yaml --out flight
nadir flight import --photos scans --interval-s 2 --agl-m 120 --focal-px 3600 --start 8.5,47.4 --out flight
nadir flight import --recorder recording --out flight)";
}

void FlightImportCommand::setup(Options& options) {
  options.values("--photos", photos_, "DIR", "folders of photos, with their subfolders, or files");
  options.value("--video", video_, "FILE", "a video instead of photos: a frame every --interval-s (1)");
  options.value("--log", log_, "FILE", "the autopilot's log: .BIN, .ulg or .tlog");
  options.value("--recorder", recorder_, "DIR", "a recording of nadird, instead of photos and a log");
  options.value("--session", session_, "ID", "of the recording, when it holds several").needs("--recorder");
  options.value("--out", out_, "OUT", "folder to create; must not exist").required();
  options.value("--frames", frames_, "HOW", "frames are links to the photos, or copies").one_of({"link", "copy"});
  options.flag("--truth", truth_, "write GPS positions to truth.csv, for scoring");
  options.value("--camera", camera_, "FILE.yaml", "the camera, if it is known; else a draft is made");
  options.value("--model", model_, "NAME", "use the photos of this camera (EXIF's model)");
  options.value("--focal-px", focal_px_, "PIXELS", "focal length in pixels of the photos").between(10, 1'000'000);
  options.value("--focal-mm", focal_mm_, "MM", "focal length, where the photos do not say it").between(0.1, 5000);
  options.value("--sensor-width-mm", sensor_width_mm_, "MM", "longer side of the sensor").between(0.5, 200);
  options.value("--mount-yaw-deg", mount_yaw_deg_, "DEGREES", "top of the image against the nose, clockwise")
      .between(-360, 360);
  options.value("--mount-pitch-deg", mount_pitch_deg_, "DEGREES", "of the camera in the aircraft; positive looks ahead")
      .between(-45, 45);
  options.value("--mount-roll-deg", mount_roll_deg_, "DEGREES", "of the camera in the aircraft; positive looks left")
      .between(-45, 45);
  options.value("--agl-m", agl_m_, "METRES", "height above ground of all photos").between(1, 20'000);
  options.value("--ground-m", ground_m_, "METRES", "height of the ground above sea level").between(-500, 9000);
  options.value("--terrain", terrain_, "FILE", "elevation model; looked up at the recorded positions");
  options.value("--takeoff", takeoff_, "LON,LAT", "place of take-off, for --terrain with heights above it")
      .needs("--terrain");
  options.value("--clock-offset-s", clock_offset_s_, "SECONDS", "log time less camera time; estimated without it")
      .needs("--log");
  options.value("--zone-h", zone_h_, "HOURS", "the camera's clock less UTC").between(-14, 14);
  options
      .value("--interval-s", interval_s_, "SECONDS",
             "between photos without times, in the order of their names; of a video")
      .between(0.001, 86'400);
  options.value("--start", start_, "LON,LAT", "position of the first photo, to about 100 m");
}

void FlightImportCommand::check() const {
  if (recorder_) {
    if (!log_ && !video_ && photos_.size() <= 1) return;
    throw UsageError({.what = "nadir flight import --recorder takes everything from the recording",
                      .expected = "at most one --photos, the folder of its images",
                      .fix = "leave out the others"});
  }
  if (photos_.empty() != !video_.has_value()) return;
  throw UsageError({.what = "nadir flight import needs a source",
                    .expected = "one of --photos DIR, --video FILE or --recorder DIR",
                    .fix = "nadir flight import --help shows examples"});
}

ImportRequest FlightImportCommand::request() const {
  ImportRequest request;
  request.photos = photos_;
  request.video = video_;
  request.log = log_;
  request.recording = recorder_;
  request.session = session_;
  request.camera = camera_;
  request.model = model_;
  request.lens = {focal_px_, focal_mm_, sensor_width_mm_};
  request.mount = {radians(mount_yaw_deg_), radians(mount_pitch_deg_), radians(mount_roll_deg_)};
  request.agl_m = agl_m_;
  request.ground_m = ground_m_;
  request.clock_offset_s = clock_offset_s_;
  if (zone_h_) request.zone_s = *zone_h_ * 3600;
  request.interval_s = interval_s_;
  request.start = start_;
  request.takeoff = takeoff_;
  request.truth = truth_;
  request.transfer = frames_ == "copy" ? FrameTransfer::copy : FrameTransfer::link;
  if (terrain_) {
    auto terrain = std::make_shared<ElevationModel>(*terrain_);
    request.ground_height_m = [terrain](LonLat place) { return terrain->height_m(place); };
  }
  return request;
}

int FlightImportCommand::run(Context& context) {
  check();
  const ImportResult result = import_flight(request(), out_, context.progress);
  const bool written = !result.findings.has_errors();
  if (context.json) {
    nlohmann::json found = nlohmann::json::object();
    for (const auto& [name, text] : result.figures) found[name] = text;
    nlohmann::json more{{"frames", result.frames}, {"found", found}};
    if (result.clock_offset_s) {
      more["clock_offset"] = {{"offset_s", *result.clock_offset_s}, {"from", result.clock_offset_from}};
      if (result.clock_offset_sigma_s) more["clock_offset"]["sigma_s"] = *result.clock_offset_sigma_s;
    }
    return report_findings(context.out, true, result.findings, more);
  }
  Figures figures;
  for (const auto& [name, text] : result.figures) figures.emplace_back(name, printable(text));
  print_figures(context.out, figures);
  const int code = report_findings(context.out, false, result.findings);
  if (context.quiet) return code;
  if (!written) {
    context.err << "nothing was written\n";
    return code;
  }
  std::string next = fmt::format(
      "nadir replay --frames {0}/frames --telemetry {0}/telemetry.csv --camera {0}/camera.yaml", out_.string());
  if (result.start) next += fmt::format(" --start={:.4f},{:.4f}", result.start->lon_deg, result.start->lat_deg);
  if (std::filesystem::exists(out_ / "truth.csv")) next += fmt::format(" --truth {}/truth.csv", out_.string());
  context.err << fmt::format("{}: {}. Next, with --package and --trust of a map if there is one:\n  {} --out result\n",
                             out_.string(), count(result.frames, "frame"), printable(next));
  return code;
}

}  // namespace

std::unique_ptr<Command> make_flight_import() { return std::make_unique<FlightImportCommand>(); }

}  // namespace nadir
