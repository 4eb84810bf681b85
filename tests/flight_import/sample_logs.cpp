#include "flight_import/sample_logs.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::test {

Attitude SampleFlight::attitude_at(double time_s) const {
  const double t = time_s - begin_s;
  // Turns of different sizes at irregular moments, each of 4 s.
  double heading_deg = 20;
  for (const auto& [at_s, turn_deg] :
       {std::pair(13.0, 95.0), {31.0, -70.0}, {42.0, 120.0}, {67.0, 88.0}, {90.0, -150.0}, {103.0, 40.0}}) {
    heading_deg += turn_deg * std::clamp((t - at_s) / 4, 0.0, 1.0);
  }
  return {wrap_pi(radians(heading_deg)), radians(2 + std::sin(t / 3)), radians(-1 + std::cos(t / 5))};
}

Eigen::Vector3d SampleFlight::rate_at(double time_s) const {
  constexpr double kStep_s = 0.005;
  return camera_rate(attitude_at(time_s - kStep_s), attitude_at(time_s + kStep_s), 2 * kStep_s);
}

namespace {

// The samples of a tenth of a second: time, turn rate; level and at rest by the accelerometers.
template <class Write>
void write_inertial(const SampleFlight& flight, double from_s, const Write& write) {
  for (int k = 0; k < flight.inertial_hz / 10; ++k) {
    const double time_s = from_s + static_cast<double>(k) / flight.inertial_hz;
    const Eigen::Vector3f rate = flight.rate_at(time_s).cast<float>();
    Packed values;
    values.put(static_cast<std::uint64_t>(std::llround(time_s * 1e6)));
    for (int axis = 0; axis < 3; ++axis) values.put(rate[axis]);
    for (const float force : {0.1F, -0.2F, -9.8F}) values.put(force);
    write(values);
  }
}

}  // namespace

DataflashWriter::DataflashWriter() { format(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"); }

void DataflashWriter::format(std::uint8_t type, std::string_view name, std::string_view types,
                             std::string_view columns) {
  std::size_t size = 3;
  for (const char c : types) {
    size += c == 'b' || c == 'B' || c == 'M'               ? 1
            : c == 'h' || c == 'H' || c == 'c' || c == 'C' ? 2
            : c == 'Q' || c == 'q' || c == 'd'             ? 8
            : c == 'N'                                     ? 16
            : c == 'Z'                                     ? 64
                                                           : 4;
  }
  Bytes body{type, static_cast<std::uint8_t>(size)};
  const auto text = [&body](std::string_view value, std::size_t width) {
    Bytes field(value.begin(), value.end());
    field.resize(width);
    body.insert(body.end(), field.begin(), field.end());
  };
  text(name, 4);
  text(types, 16);
  text(columns, 64);
  record(128, body);
}

void DataflashWriter::record(std::uint8_t type, const Bytes& body) {
  bytes.insert(bytes.end(), {0xA3, 0x95, type});
  bytes.insert(bytes.end(), body.begin(), body.end());
}

Bytes sample_dataflash(const SampleFlight& flight, const std::vector<double>& triggers_s) {
  DataflashWriter log;
  log.format(10, "ATT", "QccccCCCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw");
  log.format(11, "GPS", "QBIHBcLLef", "TimeUS,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd");
  log.format(12, "POS", "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt");
  log.format(13, "CAM", "QIHLL", "TimeUS,GPSTime,GPSWeek,Lat,Lng");
  log.format(14, "MSG", "QZ", "TimeUS,Message");
  log.format(15, "IMU", "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ");
  std::size_t next = 0;
  for (int i = 0; flight.begin_s + i * 0.1 <= flight.end_s; ++i) {
    const double t = flight.begin_s + i * 0.1;
    const auto us = static_cast<std::uint64_t>(std::llround(t * 1e6));
    write_inertial(flight, t, [&](const Bytes& values) { log.record(15, values); });
    const Attitude a = flight.attitude_at(t);
    const auto centi = [](double angle_rad) {
      return static_cast<std::int16_t>(std::lround(degrees(angle_rad) * 100));
    };
    double yaw_deg = degrees(a.heading_rad);
    if (yaw_deg < 0) yaw_deg += 360;
    log.record(10, Packed()
                       .put(us)
                       .put(std::int16_t{0})
                       .put(centi(a.roll_rad))
                       .put(std::int16_t{0})
                       .put(centi(a.pitch_rad))
                       .put(std::uint16_t{0})
                       .put(static_cast<std::uint16_t>(std::lround(yaw_deg * 100)))
                       .put(std::uint16_t{0})
                       .put(std::uint16_t{0}));
    const auto lat = static_cast<std::int32_t>(std::llround(flight.lat_at(t) * 1e7));
    const auto lon = static_cast<std::int32_t>(std::llround(flight.lon_at(t) * 1e7));
    if (i % 2 == 0) {
      const double gps_s = t + flight.unix_from_boot_s - 315'964'800 + 18;
      const auto week = static_cast<std::uint16_t>(gps_s / 604'800);
      const auto ms = static_cast<std::uint32_t>(std::llround((gps_s - week * 604'800.0) * 1e3));
      log.record(11, Packed()
                         .put(us)
                         .put(std::uint8_t{3})
                         .put(ms)
                         .put(week)
                         .put(std::uint8_t{12})
                         .put(std::int16_t{80})
                         .put(lat)
                         .put(lon)
                         .put(static_cast<std::int32_t>(std::lround((400 + flight.height_at(t)) * 100)))
                         .put(20.0F));
      log.record(12, Packed()
                         .put(us)
                         .put(lat)
                         .put(lon)
                         .put(static_cast<float>(400 + flight.height_at(t)))
                         .put(static_cast<float>(flight.height_at(t)))
                         .put(0.0F));
    }
    while (next < triggers_s.size() && triggers_s[next] <= t) {
      log.record(13, Packed()
                         .put(static_cast<std::uint64_t>(std::llround(triggers_s[next] * 1e6)))
                         .put(std::uint32_t{0})
                         .put(std::uint16_t{0})
                         .put(lat)
                         .put(lon));
      ++next;
    }
  }
  return log.bytes;
}

UlogWriter::UlogWriter(bool flags) {
  bytes = {'U', 'L', 'o', 'g', 0x01, 0x12, 0x35, 1, 0, 0, 0, 0, 0, 0, 0, 0};
  if (flags) message('B', Bytes(40));
}

void UlogWriter::message(char type, ByteView body) {
  bytes.push_back(static_cast<std::uint8_t>(body.size() & 0xFF));
  bytes.push_back(static_cast<std::uint8_t>(body.size() >> 8));
  bytes.push_back(static_cast<std::uint8_t>(type));
  bytes.insert(bytes.end(), body.begin(), body.end());
}

void UlogWriter::subscribe(std::uint16_t id, std::string_view topic, std::uint8_t instance) {
  Bytes body = Packed().put(instance).put(id);
  body.insert(body.end(), topic.begin(), topic.end());
  message('A', body);
}

void UlogWriter::data(std::uint16_t id, const Bytes& body) {
  Bytes all{static_cast<std::uint8_t>(id & 0xFF), static_cast<std::uint8_t>(id >> 8)};
  for (const std::uint8_t byte : body) all.push_back(byte);
  message('D', all);
}

Bytes sample_ulog(const SampleFlight& flight, const std::vector<double>& triggers_s) {
  UlogWriter log;
  log.format("vehicle_attitude:uint64_t timestamp;float[4] q;");
  log.format("vec3:float x;float y;float z;");
  log.format(
      "vehicle_gps_position:uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;double longitude_deg;"
      "double altitude_msl_m;uint8_t fix_type;uint8_t[7] _padding0;");
  log.format(
      "vehicle_local_position:uint64_t timestamp;vec3 where;float z;float dist_bottom;bool z_valid;"
      "bool dist_bottom_valid;uint8_t[2] _padding0;");
  log.format("camera_capture:uint64_t timestamp;uint32_t seq;int8_t result;uint8_t[3] _padding0;");
  log.subscribe(0, "vehicle_attitude");
  log.subscribe(1, "vehicle_gps_position");
  log.subscribe(2, "vehicle_local_position");
  log.format("sensor_combined:uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;");
  log.subscribe(3, "camera_capture");
  log.subscribe(4, "sensor_combined");
  std::size_t next = 0;
  for (int i = 0; flight.begin_s + i * 0.1 <= flight.end_s; ++i) {
    const double t = flight.begin_s + i * 0.1;
    const auto us = static_cast<std::uint64_t>(std::llround(t * 1e6));
    write_inertial(flight, t, [&](const Bytes& values) { log.data(4, values); });
    const Attitude a = flight.attitude_at(t);
    const double cy = std::cos(a.heading_rad / 2), sy = std::sin(a.heading_rad / 2), cp = std::cos(a.pitch_rad / 2),
                 sp = std::sin(a.pitch_rad / 2), cr = std::cos(a.roll_rad / 2), sr = std::sin(a.roll_rad / 2);
    log.data(0, Packed()
                    .put(us)
                    .put(static_cast<float>(cr * cp * cy + sr * sp * sy))
                    .put(static_cast<float>(sr * cp * cy - cr * sp * sy))
                    .put(static_cast<float>(cr * sp * cy + sr * cp * sy))
                    .put(static_cast<float>(cr * cp * sy - sr * sp * cy)));
    if (i % 2 == 0) {
      log.data(1, Packed()
                      .put(us)
                      .put(static_cast<std::uint64_t>(std::llround((t + flight.unix_from_boot_s) * 1e6)))
                      .put(flight.lat_at(t))
                      .put(flight.lon_at(t))
                      .put(400 + flight.height_at(t))
                      .put(std::uint8_t{3}));  // without the padding at the end, as PX4 writes it
      log.data(2, Packed()
                      .put(us)
                      .put(0.0F)
                      .put(0.0F)
                      .put(0.0F)
                      .put(static_cast<float>(-flight.height_at(t)))
                      .put(0.0F)
                      .put(std::uint8_t{1})
                      .put(std::uint8_t{0}));
    }
    while (next < triggers_s.size() && triggers_s[next] <= t) {
      log.data(3, Packed()
                      .put(static_cast<std::uint64_t>(std::llround(triggers_s[next] * 1e6)))
                      .put(static_cast<std::uint32_t>(next))
                      .put(std::int8_t{1}));
      ++next;
    }
  }
  return log.bytes;
}

Bytes sample_tlog(const SampleFlight& flight, const std::vector<double>& triggers_s, double delay_s) {
  const TemporaryFolder folder;
  std::string lines;
  const auto add = [&](double at_s, nlohmann::json message) {
    message["at"] = at_s + flight.unix_from_boot_s + delay_s;
    lines += message.dump() + "\n";
  };
  std::size_t next = 0;
  for (int i = 0; flight.begin_s + i * 0.25 <= flight.end_s; ++i) {
    const double t = flight.begin_s + i * 0.25;
    const auto ms = static_cast<std::int64_t>(std::llround(t * 1e3));
    const Attitude a = flight.attitude_at(t);
    if (i % 4 == 0) {
      add(t, {{"message", "HEARTBEAT"}, {"type", 1}, {"autopilot", 3}, {"mavlink_version", 3}});
      add(t, {{"message", "SYSTEM_TIME"},
              {"time_unix_usec", static_cast<std::int64_t>(std::llround((t + flight.unix_from_boot_s) * 1e6))},
              {"time_boot_ms", ms}});
      add(t, {{"message", "GPS_RAW_INT"},
              {"time_usec", ms * 1000},
              {"fix_type", 3},
              {"lat", std::llround(flight.lat_at(t) * 1e7)},
              {"lon", std::llround(flight.lon_at(t) * 1e7)},
              {"alt", std::llround((400 + flight.height_at(t)) * 1e3)}});
    }
    add(t, {{"message", "ATTITUDE"},
            {"time_boot_ms", ms},
            {"roll", a.roll_rad},
            {"pitch", a.pitch_rad},
            {"yaw", a.heading_rad}});
    add(t, {{"message", "GLOBAL_POSITION_INT"},
            {"time_boot_ms", ms},
            {"lat", std::llround(flight.lat_at(t) * 1e7)},
            {"lon", std::llround(flight.lon_at(t) * 1e7)},
            {"alt", std::llround((400 + flight.height_at(t)) * 1e3)},
            {"relative_alt", std::llround(flight.height_at(t) * 1e3)}});
    while (next < triggers_s.size() && triggers_s[next] <= t) {
      add(t,
          {{"message", "CAMERA_FEEDBACK"},
           {"time_usec", static_cast<std::int64_t>(std::llround((triggers_s[next] + flight.unix_from_boot_s) * 1e6))},
           {"img_idx", next}});
      ++next;
    }
  }
  const auto input = folder.write("messages.json", lines);
  const ProcessResult made = run_shell(fmt::format("'{}' -B '{}' write-tlog '{}' < '{}'", NADIR_PYTHON, NADIR_LOG_JUDGE,
                                                   (folder / "a.tlog").string(), input.string()));
  if (made.code != 0) throw Error({.what = "the log's writer failed", .found = made.err});
  return read_file(folder / "a.tlog");
}

}  // namespace nadir::test
