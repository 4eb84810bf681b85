#include "flight_import/ardupilot_log.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <map>
#include <string>
#include <string_view>

#include "base/error.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr std::uint8_t kHead1 = 0xA3, kHead2 = 0x95, kFormatType = 128;
constexpr std::size_t kHeadSize = 3, kFormatSize = 89;

struct DataflashField {
  char type = 0;
  std::size_t at = 0;  // in the record
};

struct DataflashFormat {
  std::string name;
  std::size_t size = 0;  // of the whole record; 0: none is known
  std::map<std::string, DataflashField, std::less<>> fields;
};

// Bytes of a field by the character of its type; 0: unknown.
std::size_t dataflash_size(char type) {
  switch (type) {
    case 'b':
    case 'B':
    case 'M': return 1;
    case 'h':
    case 'H':
    case 'c':
    case 'C':
    case 'g': return 2;
    case 'i':
    case 'I':
    case 'e':
    case 'E':
    case 'L':
    case 'f':
    case 'n': return 4;
    case 'd':
    case 'q':
    case 'Q': return 8;
    case 'N': return 16;
    case 'Z':
    case 'a': return 64;
    default: return 0;
  }
}

std::string_view padded_text(ByteView bytes) {
  const std::string_view text = as_text(bytes);
  return text.substr(0, std::min(text.find('\0'), text.size()));
}

// Nothing for a format that contradicts itself.
std::optional<DataflashFormat> parse_dataflash_format(ByteView record) {
  DataflashFormat format;
  format.size = record[4];
  format.name = padded_text(record.subspan(5, 4));
  const std::string_view types = padded_text(record.subspan(9, 16));
  std::string_view names = padded_text(record.subspan(25, 64));
  std::size_t at = kHeadSize;
  for (const char type : types) {
    const std::size_t size = dataflash_size(type);
    const std::size_t comma = names.find(',');
    if (size == 0) return std::nullopt;
    format.fields.emplace(names.substr(0, comma), DataflashField{type, at});
    names = comma == std::string_view::npos ? std::string_view() : names.substr(comma + 1);
    at += size;
  }
  if (at != format.size) return std::nullopt;
  return format;
}

class DataflashRecord {
 public:
  DataflashRecord(const DataflashFormat& format, ByteView bytes) : format_(format), bytes_(bytes) {}

  std::optional<double> number(std::string_view name) const {
    const auto found = format_.fields.find(name);
    if (found == format_.fields.end()) return std::nullopt;
    const std::size_t at = found->second.at;
    switch (found->second.type) {
      case 'b': return little_endian<std::int8_t>(bytes_, at);
      case 'B':
      case 'M': return little_endian<std::uint8_t>(bytes_, at);
      case 'h': return little_endian<std::int16_t>(bytes_, at);
      case 'H': return little_endian<std::uint16_t>(bytes_, at);
      case 'c': return little_endian<std::int16_t>(bytes_, at) * 0.01;
      case 'C': return little_endian<std::uint16_t>(bytes_, at) * 0.01;
      case 'i': return little_endian<std::int32_t>(bytes_, at);
      case 'I': return little_endian<std::uint32_t>(bytes_, at);
      case 'e': return little_endian<std::int32_t>(bytes_, at) * 0.01;
      case 'E': return little_endian<std::uint32_t>(bytes_, at) * 0.01;
      case 'L': return little_endian<std::int32_t>(bytes_, at) * 1e-7;
      case 'f': return little_endian<float>(bytes_, at);
      case 'd': return little_endian<double>(bytes_, at);
      case 'q': return static_cast<double>(little_endian<std::int64_t>(bytes_, at));
      case 'Q': return static_cast<double>(little_endian<std::uint64_t>(bytes_, at));
      default: return std::nullopt;
    }
  }
  double number_or_nan(std::string_view name) const { return number(name).value_or(std::nan("")); }
  std::optional<double> number(std::string_view name, std::string_view older) const {
    const auto value = number(name);
    return value ? value : number(older);
  }
  // Since the autopilot's start. Firmware before 3.3 counts milliseconds, but in GPS records TimeMS is the time of the
  // GPS week, and T that of the log.
  std::optional<double> time_s() const {
    if (const auto us = number("TimeUS")) return *us * 1e-6;
    if (const auto ms = number("T"); ms && name() == "GPS") return *ms * 1e-3;
    if (const auto ms = number("TimeMS")) return *ms * 1e-3;
    return std::nullopt;
  }
  const std::string& name() const { return format_.name; }

 private:
  const DataflashFormat& format_;
  ByteView bytes_;
};

// Seconds between GPS time and UTC, by the GPS week. Leap seconds came into force in these weeks.
double leap_seconds(double gps_week) {
  if (gps_week >= 1930) return 18;  // 2017-01-01
  if (gps_week >= 1851) return 17;  // 2015-07-01
  if (gps_week >= 1695) return 16;  // 2012-07-01
  return 15;
}

constexpr double kGpsEpoch_s = 315'964'800;  // 1980-01-06, since 1970
constexpr double kWeek_s = 604'800;

class DataflashInterpreter {
 public:
  DataflashInterpreter() : builder_("ArduPilot dataflash log") {}

  LogBuilder& builder() { return builder_; }

  void take(const DataflashRecord& record) {
    const auto time_s = record.time_s();
    const std::string& name = record.name();
    const bool wanted = name == "ATT" || name == "GPS" || name == "POS" || name == "BARO" || name == "RFND" ||
                        name == "TERR" || name == "CAM" || name == "TRIG" || name == "IMU";
    if (!wanted || !time_s || !builder_.take_time(*time_s)) return;
    if (name == "ATT") {
      builder_.attitude(*time_s, radians(record.number_or_nan("Yaw")), radians(record.number_or_nan("Pitch")),
                        radians(record.number_or_nan("Roll")));
    } else if (name == "IMU") {
      take_inertial(*time_s, record);
    } else if (name == "GPS") {
      take_gps(*time_s, record);
    } else if (name == "POS") {
      builder_.height(&FlightLog::msl_heights, *time_s, record.number_or_nan("Alt"));
      builder_.height(&FlightLog::home_heights, *time_s, record.number_or_nan("RelHomeAlt"));
    } else if (name == "BARO") {
      if (record.number("I").value_or(0) == 0) baro_.push_back({*time_s, record.number_or_nan("Alt")});
    } else if (name == "RFND") {
      take_range(*time_s, record);
    } else if (name == "TERR") {
      constexpr double kTerrainOk = 2;
      if (record.number("Status").value_or(kTerrainOk) == kTerrainOk) {
        builder_.height(&FlightLog::terrain_heights, *time_s, record.number_or_nan("CHeight"));
      }
    } else if (name == "CAM") {
      if (record.number("I").value_or(0) == 0) builder_.trigger(*time_s);
    } else if (record.number("I").value_or(0) == 0) {
      builder_.commanded_trigger(*time_s);
    }
  }

  FlightLog finish() {
    FlightLog log = builder_.finish();
    if (log.home_heights.empty()) {
      LogBuilder barometric("");
      for (const TimedHeight& sample : baro_) {
        barometric.height(&FlightLog::home_heights, sample.time_s, sample.height_m);
      }
      log.home_heights = barometric.finish().home_heights;
    }
    return log;
  }

 private:
  void take_inertial(double time_s, const DataflashRecord& record) {
    if (record.number("I").value_or(0) != 0) return;
    builder_.inertial(time_s,
                      {record.number_or_nan("GyrX"), record.number_or_nan("GyrY"), record.number_or_nan("GyrZ")},
                      {record.number_or_nan("AccX"), record.number_or_nan("AccY"), record.number_or_nan("AccZ")});
  }

  void take_gps(double time_s, const DataflashRecord& record) {
    constexpr double kFix3d = 3;
    if (record.number("I").value_or(0) != 0 || !(record.number_or_nan("Status") >= kFix3d)) return;
    builder_.position(time_s, {record.number_or_nan("Lng"), record.number_or_nan("Lat")}, record.number_or_nan("Alt"));
    const auto week = record.number("GWk", "Week");
    const auto ms = record.number("GMS", "TimeMS");
    if (week && ms && *week > 1000 && *ms >= 0) {
      builder_.utc(time_s, kGpsEpoch_s + *week * kWeek_s + *ms * 1e-3 - leap_seconds(*week));
    }
  }

  void take_range(double time_s, const DataflashRecord& record) {
    constexpr double kDown = 25, kGood = 4;
    const auto orientation = record.number("Orient", "Orient1");
    if (orientation && *orientation != kDown) return;
    if (record.number("Stat", "Stat1").value_or(kGood) != kGood) return;
    if (record.number("I", "Instance").value_or(0) != 0) return;
    const double distance_m = record.number("Dist", "Dist1").value_or(std::nan(""));
    if (distance_m > 0) builder_.height(&FlightLog::ranges, time_s, distance_m);
  }

  LogBuilder builder_;
  std::vector<TimedHeight> baro_;
};

}  // namespace

bool is_ardupilot_log(LogStream& stream) {
  const ByteView head = stream.peek(kHeadSize);
  return head.size() == kHeadSize && head[0] == kHead1 && head[1] == kHead2 && head[2] == kFormatType;
}

FlightLog read_ardupilot_log(LogStream& stream) {
  if (!is_ardupilot_log(stream)) {
    throw UsageError({.what = "this is no ArduPilot dataflash log",
                      .where = stream.name(),
                      .expected = "a .BIN file, which begins with the bytes A3 95 80",
                      .found = stream.size() == 0 ? "an empty file" : "other bytes",
                      .fix = "a text log (.log) is converted by mavlogdump.py; download the .BIN file instead"});
  }
  std::array<DataflashFormat, 256> formats;
  DataflashInterpreter interpreter;
  FlightLog& log = interpreter.builder().log();
  bool lost = false;  // searching for the next record
  while (!stream.at_end() && !interpreter.builder().restarted()) {
    const ByteView record = stream.peek(256);
    const bool begins = record.size() >= kHeadSize && record[0] == kHead1 && record[1] == kHead2;
    const std::uint8_t type = begins ? record[2] : std::uint8_t{0};
    const std::size_t size = !begins ? 0 : type == kFormatType ? kFormatSize : formats[type].size;
    if (record.size() < kHeadSize || size > record.size()) {
      log.truncated = true;
      break;
    }
    if (size == 0) {
      if (!lost) ++log.damaged;
      lost = true;
      ++log.skipped_bytes;
      stream.skip(1);
      continue;
    }
    lost = false;
    ++log.records;
    if (type == kFormatType) {
      auto format = parse_dataflash_format(record);
      if (format && record[3] != kFormatType) {
        formats[record[3]] = std::move(*format);
      } else if (!format) {
        // Without its fields a record can still be skipped.
        ++log.damaged;
        if (record[4] >= kHeadSize && record[3] != kFormatType)
          formats[record[3]] = {.name = {}, .size = record[4], .fields = {}};
      }
    } else {
      interpreter.take({formats[type], record.first(size)});
    }
    stream.skip(size);
  }
  return interpreter.finish();
}

}  // namespace nadir
