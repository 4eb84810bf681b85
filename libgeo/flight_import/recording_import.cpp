#include "flight_import/recording_import.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "base/input_file.hpp"
#include "base/plural.hpp"
#include "base/printable.hpp"
#include "geodesy/angles.hpp"
#include "imagery/frame_image.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

// Names of a recording may be anything.
std::string recorded_name(const std::string& frame, const fs::path& file, std::size_t index) {
  const bool plain = !frame.empty() && frame == printable(frame) && frame.find_first_of("/\",") == std::string::npos &&
                     !frame.starts_with('.') && frame.size() < 200;
  if (plain && has_frame_extension(frame)) return frame;
  const InputFile image(file);
  Bytes head(std::min<std::uint64_t>(16, image.size()));
  image.read_at(0, head);
  const auto format = sniff_image_format(head);
  const char* extension = is_tiff(head) ? ".tif" : format == ImageFormat::png ? ".png" : ".jpg";
  return (plain ? frame : fmt::format("{:08}", index)) + extension;
}

// Of all intervals since the last frame; nothing where one of them is unknown.
std::optional<Eigen::Vector2d> whole_velocity_change(const Telemetry& telemetry) {
  if (!telemetry.imu_dv_mps) return std::nullopt;
  Eigen::Vector2d sum = *telemetry.imu_dv_mps;
  for (const TelemetryInterval& interval : telemetry.intervals) {
    if (!interval.imu_dv_mps) return std::nullopt;
    sum += *interval.imu_dv_mps;
  }
  return sum;
}

}  // namespace

ImportedRecording import_recording(const RecordedFlightSource& source, bool truth) {
  const RecordedFlight recorded = read_recorded_flight(source);
  ImportedRecording result;
  std::set<std::string> taken;
  std::size_t renamed = 0, empty = 0;
  for (std::size_t i = 0; i < recorded.flight.frames.size(); ++i) {
    const Telemetry& telemetry = recorded.flight.frames[i];
    result.inertial.insert(result.inertial.end(), telemetry.inertial.begin(), telemetry.inertial.end());
    ImportedFrame frame;
    frame.file = recorded.flight.image_path(i);
    std::error_code error;
    if (!fs::is_regular_file(frame.file, error)) {
      ++empty;
      continue;
    }
    frame.name = recorded_name(telemetry.frame, frame.file, i);
    renamed += frame.name == telemetry.frame ? 0U : 1U;
    if (!taken.insert(frame.name).second) {
      frame.name = fmt::format("{:08}_{}", i, frame.name);
      taken.insert(frame.name);
    }
    frame.time_s = telemetry.time_s;
    frame.agl_m = telemetry.agl_m;
    frame.heading_rad = telemetry.heading_rad;
    frame.pitch_rad = telemetry.pitch_rad;
    frame.roll_rad = telemetry.roll_rad;
    frame.imu_dv_mps = whole_velocity_change(telemetry);
    frame.rate_rad_s = telemetry.rate_rad_s;
    if (truth) frame.place = telemetry.gps_position;
    if (!result.frames.empty()) frame.time_s = std::max(frame.time_s, result.frames.back().time_s + kMinFrameStep_s);
    result.frames.push_back(std::move(frame));
  }
  result.text = fmt::format("session {}, {} of {}", recorded.session.id, count(result.frames.size(), "frame"),
                            recorded.session.airframe);
  result.start = recorded.session.start;
  if (empty + recorded.unusable_inputs > 0) {
    result.findings.add(
        {"import.recording_gaps", Severity::warning, source.recording.string(), "the images of all frames",
         fmt::format("{} without one, {} after a gap in the recording", empty, recorded.unusable_inputs),
         "they are left out; --photos DIR names the folder of the images"});
  }
  if (renamed > 0) {
    result.findings.add({"import.names", Severity::note, count(renamed, "frame"),
                         "file names with the extension of an image", "other names",
                         "the extension is added, or the frame's number"});
  }
  const CameraFile& file = recorded.session.camera;
  const CameraModel& camera = file.camera;
  result.camera_yaml = fmt::format(
      "# As it was flown: session {}.\nmodel: pinhole\nwidth: {}\nheight: {}\nfx: {}\nfy: {}\ncx: {}\ncy: {}\n"
      "distortion: [{}, {}, {}, {}, {}]\nuncertainty: {{heading_deg: {}, agl_relative: {}, tilt_deg: {}, imu_dv_mps: "
      "{}}}\n",
      printable(recorded.session.id), camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy,
      camera.distortion[0], camera.distortion[1], camera.distortion[2], camera.distortion[3], camera.distortion[4],
      degrees(file.uncertainty.heading_rad), file.uncertainty.agl_relative, degrees(file.uncertainty.tilt_rad),
      file.uncertainty.imu_dv_mps);
  if (file.readout) {
    result.camera_yaml += fmt::format("rolling_shutter: {{row_time_s: {}, direction: {}}}\n", file.line_time_s(),
                                      name_of(file.readout->direction));
  }
  if (file.on_gimbal) result.camera_yaml += "on_gimbal: true\n";
  return result;
}

}  // namespace nadir
