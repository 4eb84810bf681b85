#include "flight_import/mavlink_log.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <vector>

#include "base/error.hpp"
#include "mavlink/camera_messages.hpp"
#include "mavlink/messages.hpp"

namespace nadir {
namespace {

constexpr std::size_t kTlogStamp = 8;
constexpr std::uint8_t kMavlink1 = 0xFE, kMavlink2 = 0xFD;

// The time of arrival of the record that begins here; nothing when none does.
std::optional<double> tlog_arrival_s(ByteView bytes) {
  if (bytes.size() < kTlogStamp + 3) return std::nullopt;
  const std::uint8_t start = bytes[kTlogStamp];
  if (start != kMavlink1 && start != kMavlink2) return std::nullopt;
  std::uint64_t us = 0;
  for (std::size_t i = 0; i < kTlogStamp; ++i) us = us << 8 | bytes[i];
  constexpr std::uint64_t kYear2000_us = 946'684'800'000'000, kYear2100_us = 4'102'444'800'000'000;
  if (us < kYear2000_us || us > kYear2100_us) return std::nullopt;
  return static_cast<double>(us) * 1e-6;
}

// Bytes of the frame after the stamp, as its header states.
std::size_t tlog_frame_size(ByteView frame) {
  if (frame[0] == kMavlink1) return 6U + frame[1] + 2U;
  const bool has_signature = (frame[2] & 1U) != 0;
  return 10U + frame[1] + 2U + (has_signature ? kSignatureSize : 0U);
}

Eigen::Vector3d vector_of(const Vector3& vector) { return {vector.x, vector.y, vector.z}; }

class TlogInterpreter {
 public:
  TlogInterpreter() : builder_("MAVLink telemetry log") {}

  LogBuilder& builder() { return builder_; }

  void take(const MavlinkFrame& frame, double arrival_s) {
    if (const auto picture = decode_picture_report(frame)) {
      if (vehicle_ && frame.source.system == vehicle_->system) pictures_.push_back({*picture, arrival_s});
      return;
    }
    const auto message = decode(frame);
    if (!message) return;
    if (const auto* heartbeat = std::get_if<Heartbeat>(&*message); heartbeat != nullptr && heartbeat->is_autopilot) {
      autopilots_.insert(frame.source.system);
      if (!vehicle_) vehicle_ = frame.source;
    }
    if (!vehicle_ || frame.source != *vehicle_) return;
    if (const auto* attitude = std::get_if<AircraftAttitude>(&*message)) {
      if (const auto time_s = boot_time(attitude->boot_ms, arrival_s)) {
        builder_.attitude(*time_s, attitude->yaw_rad, attitude->pitch_rad, attitude->roll_rad);
      }
    } else if (const auto* sample = std::get_if<ImuSample>(&*message)) {
      const double time_s = static_cast<double>(sample->time_us) * 1e-6;
      if (sample->instance == 1 && builder_.take_time(time_s)) {
        builder_.inertial(time_s, vector_of(sample->rate_rad_s), vector_of(sample->acceleration_mps2));
      }
    } else if (const auto* position = std::get_if<GlobalPosition>(&*message)) {
      if (const auto time_s = boot_time(position->boot_ms, arrival_s)) {
        builder_.height(&FlightLog::msl_heights, *time_s, position->msl_m);
        builder_.height(&FlightLog::home_heights, *time_s, position->above_home_m);
      }
    } else if (const auto* distance = std::get_if<GroundDistance>(&*message)) {
      const bool valid = distance->distance_m > 0 && distance->distance_m >= distance->min_m &&
                         (distance->max_m <= 0 || distance->distance_m <= distance->max_m);
      const auto time_s = boot_time(distance->boot_ms, arrival_s);
      if (valid && time_s) builder_.height(&FlightLog::ranges, *time_s, distance->distance_m);
    } else if (const auto* ground = std::get_if<GroundHeight>(&*message)) {
      terrain_.push_back({arrival_s, ground->above_terrain_m});
    } else if (const auto* gps = std::get_if<GpsRaw>(&*message)) {
      if (gps->receiver == 1 && gps->fix >= GpsFix::three_d) fixes_.push_back({arrival_s, gps->place, gps->msl_m});
    } else if (const auto* time = std::get_if<SystemTime>(&*message)) {
      const double boot_s = time->boot_ms * 1e-3;
      if (time->unix_us && builder_.take_time(boot_s)) builder_.utc(boot_s, static_cast<double>(*time->unix_us) * 1e-6);
    }
  }

  FlightLog finish() {
    const double arrival_from_boot_s = shortest_delay();
    LogBuilder others("");
    for (const TimedHeight& sample : terrain_) {
      others.height(&FlightLog::terrain_heights, sample.time_s - arrival_from_boot_s, sample.height_m);
    }
    for (const TimedPosition& fix : fixes_) others.position(fix.time_s - arrival_from_boot_s, fix.place, fix.msl_m);
    FlightLog log = builder_.finish();
    if (!log.unix_from_log_s && !delays_s_.empty()) {
      log.unix_from_log_s = arrival_from_boot_s;
      log.utc_from = "ground station";
    }
    std::vector<double> taken_s, triggered_s;
    for (const ArrivedPicture& one : pictures_) {
      auto& times_s = one.report.kind == PictureReport::Kind::triggered ? triggered_s : taken_s;
      if (one.report.boot_s) {
        times_s.push_back(*one.report.boot_s);
      } else if (one.report.unix_s && log.unix_from_log_s && log.utc_from == "GPS") {
        times_s.push_back(*one.report.unix_s - *log.unix_from_log_s);
      } else {
        times_s.push_back(one.arrival_s - arrival_from_boot_s);
      }
    }
    std::sort(taken_s.begin(), taken_s.end());
    std::sort(triggered_s.begin(), triggered_s.end());
    for (const double time_s : taken_s) others.trigger(time_s);
    for (const double time_s : triggered_s) others.commanded_trigger(time_s);
    FlightLog rest = others.finish();
    log.terrain_heights = std::move(rest.terrain_heights);
    log.positions = std::move(rest.positions);
    log.triggers = std::move(rest.triggers);
    log.vehicles = std::max<std::size_t>(1, autopilots_.size());
    return log;
  }

 private:
  struct ArrivedPicture {
    PictureReport report;
    double arrival_s = 0;
  };

  std::optional<double> boot_time(std::uint32_t boot_ms, double arrival_s) {
    const double time_s = boot_ms * 1e-3;
    if (!builder_.take_time(time_s)) return std::nullopt;
    delays_s_.push_back(arrival_s - time_s);
    return time_s;
  }

  // Arrival less time since boot, of the messages that came quickest: its fifth percentile, because a single one may be
  // wrong.
  double shortest_delay() {
    if (delays_s_.empty()) return 0;
    const auto quick = delays_s_.begin() + static_cast<std::ptrdiff_t>(delays_s_.size() / 20);
    std::nth_element(delays_s_.begin(), quick, delays_s_.end());
    return *quick;
  }

  LogBuilder builder_;
  std::optional<MavlinkAddress> vehicle_;
  std::set<std::uint8_t> autopilots_;
  std::vector<double> delays_s_;
  std::vector<TimedHeight> terrain_;  // at their times of arrival …
  std::vector<TimedPosition> fixes_;  // … likewise
  std::vector<ArrivedPicture> pictures_;
};

}  // namespace

bool is_mavlink_log(LogStream& stream) { return tlog_arrival_s(stream.peek(kTlogStamp + 3)).has_value(); }

FlightLog read_mavlink_log(LogStream& stream) {
  if (!is_mavlink_log(stream)) {
    throw UsageError({.what = "this is no MAVLink telemetry log",
                      .where = stream.name(),
                      .expected = "a .tlog file: a time of 8 bytes and a MAVLink frame, again and again",
                      .found = stream.size() == 0 ? "an empty file" : "other bytes",
                      .fix = "a raw stream (.raw, .mavlink) has no times; give the .tlog beside it"});
  }
  TlogInterpreter interpreter;
  FlightLog& log = interpreter.builder().log();
  bool lost = false;
  while (!stream.at_end() && !interpreter.builder().restarted()) {
    const ByteView record = stream.peek(kTlogStamp + kMaxFrameSize);
    const auto arrival_s = tlog_arrival_s(record);
    if (!arrival_s) {
      if (record.size() < kTlogStamp + 3) {
        log.truncated = true;
        break;
      }
      if (!lost) ++log.damaged;
      lost = true;
      ++log.skipped_bytes;
      stream.skip(1);
      continue;
    }
    const std::size_t size = tlog_frame_size(record.subspan(kTlogStamp));
    if (kTlogStamp + size > record.size()) {
      log.truncated = true;
      break;
    }
    FrameReader reader;
    reader.add(record.subspan(kTlogStamp, size));
    reader.finish();
    if (const auto frame = reader.next(); frame && frame->bytes.size() == size) {
      lost = false;
      ++log.records;
      interpreter.take(*frame, *arrival_s);
      stream.skip(kTlogStamp + size);
    } else if (reader.counts().unknown > 0 && reader.counts().bad_crc == 0) {  // a message of another dialect
      lost = false;
      ++log.records;
      stream.skip(kTlogStamp + size);
    } else {
      if (!lost) ++log.damaged;
      lost = true;
      ++log.skipped_bytes;
      stream.skip(1);
    }
  }
  return interpreter.finish();
}

}  // namespace nadir
