// nadir provision boresight: how the camera sits in the aircraft, from a flight during which GPS was good.
#include <fmt/format.h>

#include <array>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>

#include "base/error.hpp"
#include "base/time.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/keys/root_signing.hpp"
#include "commands/scratch_folder.hpp"
#include "estimation/localizer.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"
#include "provision/airframe_manifest.hpp"
#include "provision/boresight.hpp"
#include "replay/flight_folder.hpp"
#include "replay/flight_request.hpp"
#include "replay/inertial_file.hpp"
#include "replay/recorded_flight.hpp"
#include "token_keys/token_key.hpp"

namespace nadir {
namespace {

std::string with_sigma(double value_rad, double sigma_rad) {
  return fmt::format("{:+.2f}° (σ {:.2f}°)", degrees(value_rad), degrees(sigma_rad));
}

std::array<double, 3> in_degrees(const Eigen::Vector3d& vector) {
  return {degrees(vector.x()), degrees(vector.y()), degrees(vector.z())};
}

class ProvisionBoresightCommand final : public Command {
 public:
  std::string_view group() const override { return "provision"; }
  std::string_view name() const override { return "boresight"; }
  std::string_view summary() const override {
    return "determine how the camera is mounted from a flight with good GPS";
  }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void date_file(Airframe& airframe, const Clock& clock) const;
  Flight read_flight_segment(const std::filesystem::path& unpacked) const;
  std::optional<GyroDelay> delay_by_gyroscopes(const BoresightFlight& from, const Airframe& airframe,
                                               Progress& progress) const;
  int report(Context& context, const Findings& findings, const std::optional<Boresight>& boresight,
             const std::optional<GyroDelay>& gyro, std::size_t looked_at, double delay_s) const;

  std::filesystem::path airframe_, package_, trust_;
  std::optional<std::filesystem::path> frames_, telemetry_, recorder_, key_, out_;
  std::optional<std::string> session_;
  std::optional<double> from_s_, to_s_;
  std::optional<UtcTime> at_, expires_;
  std::optional<std::int64_t> sequence_;
  double gps_sigma_m_ = 1.5;
  int most_frames_ = 150;
  BoresightLimits limits_;
};

std::string_view ProvisionBoresightCommand::details() const {
  return R"(Fly legs in all directions over the package's area while GPS is good. Each frame is matched to the
map on its own; the systematic difference between GPS, the autopilot's attitude and the map over all
frames is the mount. With --key and --out a signed airframe file with the new mount is written if it
is determined well enough.

Exit codes: 0 success, 1 the package was rejected or the flight does not determine the mount, 2 the
job could not be done.)";
}

std::string_view ProvisionBoresightCommand::examples() const {
  return R"(nadir provision boresight --airframe airframe.json --package valley --trust root.json --recorder flight
nadir provision boresight --airframe airframe.json --package valley --trust root.json --frames frames --telemetry telemetry.csv --key hangar.key.pem --out falcon-7)";
}

void ProvisionBoresightCommand::setup(Options& options) {
  options.value("--airframe", airframe_, "FILE.json", "airframe file: its camera, and the mount that it flew with")
      .required();
  options.value("--package", package_, "PACKAGE", "mission package of the flight's area").required();
  options.value("--trust", trust_, "FILE.json", "root of trust that the package must be signed under").required();
  options.value("--recorder", recorder_, "DIR", "recording of the flight, with its frames");
  options.value("--session", session_, "ID", "session of the recording, if it holds several").needs("--recorder");
  options.value("--frames", frames_, "DIR", "folder with the frames");
  options
      .value("--telemetry", telemetry_, "FILE.csv",
             "one row per frame: lat and lon from GPS, and the aircraft's own attitude")
      .needs("--frames");
  options.value("--from-s", from_s_, "S", "start at this time of the flight");
  options.value("--to-s", to_s_, "S", "end at this time of the flight");
  options.value("--max-frames", most_frames_, "N", "maximum number of frames, evenly chosen")
      .between(3, 100'000)
      .formerly("--most-frames");
  options.value("--min-frames", limits_.min_frames, "N", "minimum number of frames matched to the map")
      .between(3, 100'000);
  options.value("--gps-sigma-m", gps_sigma_m_, "M", "1-σ error of GPS per axis").between(0.01, 50);
  options.value("--key", key_, "KEY.pem", "private key (file or pkcs11: URI) that signs the airframe file")
      .needs("--out");
  options.value("--out", out_, "DIR", "folder to create for the airframe file and its signature").needs("--key");
  options
      .value("--sequence", sequence_, "N", "number of the new airframe file; default: one more than that of --airframe")
      .between(1, 1'000'000'000)
      .needs("--out");
  options.value("--expires", expires_, "DATE", "end of validity of the new airframe file; default: as of --airframe")
      .needs("--out");
  options.value("--at", at_, "TIME", "evaluate validity as of this time");
}

Flight ProvisionBoresightCommand::read_flight_segment(const std::filesystem::path& unpacked) const {
  if (recorder_.has_value() == telemetry_.has_value()) {
    throw UsageError({.what = "exactly one flight is required", .expected = "--recorder, or --frames and --telemetry"});
  }
  Flight flight;
  if (recorder_) {
    flight = read_recorded_flight({*recorder_, session_, frames_, unpacked}).flight;
  } else {
    flight.frames = read_telemetry(*telemetry_);
    const std::filesystem::path inertial = telemetry_->parent_path() / kInertialFile;
    if (std::filesystem::exists(inertial)) add_inertial(flight.frames, read_inertial(inertial), inertial);
    flight.frames_folder = *frames_;
  }
  const double from_s = from_s_.value_or(-std::numeric_limits<double>::infinity());
  const double to_s = to_s_.value_or(std::numeric_limits<double>::infinity());
  Flight segment{flight.camera, flight.frames_folder, {}, 0, {}};
  std::size_t with_gps = 0;
  for (std::size_t i = 0; i < flight.frames.size(); ++i) {
    if (flight.frames[i].time_s < from_s || flight.frames[i].time_s > to_s) continue;
    with_gps += flight.frames[i].gps_position.has_value();
    segment.frames.push_back(flight.frames[i]);
    if (!flight.files.empty()) segment.files.push_back(flight.files[i]);
  }
  if (with_gps == 0) {
    throw UsageError({.what = "no frame of this flight has a GPS position",
                      .where = recorder_ ? *recorder_ : *telemetry_,
                      .expected = recorder_ ? "a flight during which the autopilot sent its GPS receiver's position"
                                            : "columns lat and lon",
                      .fix = "use another flight, or another interval (--from-s, --to-s)"});
  }
  return segment;
}

// Sequence and end of validity of the file that is written.
void ProvisionBoresightCommand::date_file(Airframe& airframe, const Clock& clock) const {
  if (!expires_ && !airframe.expires) {
    throw UsageError({.what = "an airframe file has an end of validity",
                      .where = airframe_,
                      .expected = "--expires DATE, because this file has none to keep"});
  }
  if (sequence_ && *sequence_ <= airframe.sequence.value_or(0)) {
    throw UsageError(
        {.what = "aircraft would reject the new airframe file as a rollback",
         .where = "--sequence",
         .expected = "more than " + std::to_string(*airframe.sequence) + ", which " + airframe_.string() + " has",
         .found = std::to_string(*sequence_),
         .fix = "omit --sequence, or give a higher one"});
  }
  airframe.sequence = sequence_.value_or(airframe.sequence.value_or(0) + 1);
  if (expires_) airframe.expires = expires_;
  check_expires(*airframe.expires, clock);
}

std::optional<GyroDelay> ProvisionBoresightCommand::delay_by_gyroscopes(const BoresightFlight& from,
                                                                        const Airframe& airframe,
                                                                        Progress& progress) const {
  const std::vector<InertialSample> samples = inertial_samples(from.flight);
  if (samples.empty() || airframe.camera.on_gimbal) return std::nullopt;  // a gimbal turns without the sensor
  const std::vector<ImageTurn> turns = measure_image_turns(from.flight, samples, airframe.camera, from.assumed_mount,
                                                           airframe.mount, from.most_frames, progress);
  return solve_gyro_delay(turns, samples);
}

int ProvisionBoresightCommand::run(Context& context) {
  Airframe airframe = read_airframe(airframe_);
  std::optional<PrivateKey> key;
  if (key_) key = read_signing_key(*key_);
  if (out_ && std::filesystem::exists(std::filesystem::symlink_status(*out_))) {
    throw UsageError({.what = "the output already exists",
                      .where = *out_,
                      .expected = "a new folder",
                      .fix = "move it away, or choose another --out"});
  }
  if (out_) date_file(airframe, context.clock);
  const ScratchFolder scratch("nadir-boresight");
  const Flight flight = read_flight_segment(scratch.path());
  Opening opening =
      open_flight_map({package_, trust_, std::nullopt}, evaluation_time(at_, context.clock), context.progress);
  if (!opening.package) return report_findings(context.out, context.json, opening.findings);

  const BoresightFlight from{flight, recorder_ ? airframe.mount : Attitude{}, static_cast<std::size_t>(most_frames_)};
  const BoresightMeasurements seen =
      measure_boresight(from, airframe.camera, airframe.mount, *opening.package, context.progress);
  BoresightSettings settings{airframe.mount, airframe.camera.uncertainty};
  settings.gps_sigma_m = gps_sigma_m_;
  settings.gyro_delay = delay_by_gyroscopes(from, airframe, context.progress);
  settings.offset_sigma_m = hypotenuse(settings.offset_sigma_m, map_sigma_m(opening.package->imagery()));
  const auto boresight = solve_boresight(seen.measurements, settings);
  Findings findings = check_boresight(boresight, limits_);
  const double configured_delay_s = airframe.capture_delay_s;
  if (boresight) {
    airframe.mount = boresight->mount;
    airframe.capture_delay_s = std::max(configured_delay_s + boresight->delay_s, 0.0);
  }
  if (!findings.has_errors() && out_) write_airframe(*out_, airframe, *key);
  return report(context, findings, boresight, settings.gyro_delay, seen.frames, airframe.capture_delay_s);
}

int ProvisionBoresightCommand::report(Context& context, const Findings& findings,
                                      const std::optional<Boresight>& boresight, const std::optional<GyroDelay>& gyro,
                                      std::size_t looked_at, double delay_s) const {
  if (!boresight) return report_findings(context.out, context.json, findings);
  const Boresight& b = *boresight;
  if (context.json) {
    return report_findings(context.out, true, findings,
                           {{"frames", looked_at},
                            {"frames_used", b.used},
                            {"frames_set_aside", b.outliers},
                            {"mount_deg",
                             {{"yaw", degrees(b.mount.heading_rad)},
                              {"pitch", degrees(b.mount.pitch_rad)},
                              {"roll", degrees(b.mount.roll_rad)}}},
                            {"mount_sigma_deg",
                             {{"yaw", degrees(b.mount_sigma.heading_rad)},
                              {"pitch", degrees(b.mount_sigma.pitch_rad)},
                              {"roll", degrees(b.mount_sigma.roll_rad)}}},
                            {"capture_delay_s", delay_s},
                            {"capture_delay_seen", b.delay_observable},
                            {"capture_delay_sigma_s", b.delay_sigma_s},
                            {"gyroscopes", gyro ? nlohmann::json{{"delay_s", gyro->delay_s},
                                                                 {"delay_sigma_s", gyro->sigma_s},
                                                                 {"bias_deg_s", in_degrees(gyro->bias_rad_s)},
                                                                 {"mount_deg", in_degrees(gyro->mount_rad)},
                                                                 {"pairs_used", gyro->used},
                                                                 {"pairs_set_aside", gyro->outliers}}
                                                : nlohmann::json()},
                            {"offset_m", {b.offset_m.x(), b.offset_m.y()}},
                            {"height_factor", b.height_factor},
                            {"misfit", b.misfit}});
  }
  if (!findings.empty()) print_findings(context.out, findings);
  print_figures(
      context.out,
      {{"frames", fmt::format("{} evaluated, {} used, {} rejected", looked_at, b.used, b.outliers)},
       {"yaw", with_sigma(b.mount.heading_rad, b.mount_sigma.heading_rad)},
       {"pitch", with_sigma(b.mount.pitch_rad, b.mount_sigma.pitch_rad)},
       {"roll", with_sigma(b.mount.roll_rad, b.mount_sigma.roll_rad)},
       {"capture delay", b.delay_observable
                             ? fmt::format("{:.3f} s (σ {:.3f} s)", delay_s, b.delay_sigma_s)
                             : fmt::format("{:.3f} s as configured; this flight does not determine it", delay_s)},
       {"gyroscopes", gyro ? fmt::format("frames {:+.4f} s later than configured (σ {:.4f} s), by {} of {} turns",
                                         gyro->delay_s, gyro->sigma_s, gyro->used, gyro->used + gyro->outliers)
                           : "no samples that tell the delay"},
       {"GPS to map", fmt::format("{:+.1f} m east, {:+.1f} m north", b.offset_m.x(), b.offset_m.y())},
       {"height", fmt::format("{:.3f} of the reported height", b.height_factor)},
       {"misfit", fmt::format("{:.2f} (1: residuals match the uncertainty)", b.misfit)},
       {"written", findings.has_errors() || !out_ ? "nothing" : out_->string()}});
  return findings.has_errors() ? kRefused : kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_provision_boresight() { return std::make_unique<ProvisionBoresightCommand>(); }

}  // namespace nadir
