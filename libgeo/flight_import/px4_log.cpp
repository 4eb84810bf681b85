#include "flight_import/px4_log.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <string_view>

#include "base/error.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr std::array<std::uint8_t, 7> kUlogMagic{'U', 'L', 'o', 'g', 0x01, 0x12, 0x35};
constexpr std::size_t kUlogHeader = 16, kMessageHead = 3;
constexpr std::size_t kMaxTopicBytes = 65'536;  // a message's length has two bytes
constexpr int kMaxNesting = 8;
constexpr std::size_t kMaxFormats = 4096, kMaxTopicFields = 20'000;

enum class UlogType { i8, u8, i16, u16, i32, u32, i64, u64, f32, f64 };

struct UlogBasic {
  std::string_view name;
  UlogType type;
  std::size_t size;
};
constexpr std::array<UlogBasic, 12> kUlogBasics{{{"int8_t", UlogType::i8, 1},
                                                 {"uint8_t", UlogType::u8, 1},
                                                 {"bool", UlogType::u8, 1},
                                                 {"char", UlogType::u8, 1},
                                                 {"int16_t", UlogType::i16, 2},
                                                 {"uint16_t", UlogType::u16, 2},
                                                 {"int32_t", UlogType::i32, 4},
                                                 {"uint32_t", UlogType::u32, 4},
                                                 {"int64_t", UlogType::i64, 8},
                                                 {"uint64_t", UlogType::u64, 8},
                                                 {"float", UlogType::f32, 4},
                                                 {"double", UlogType::f64, 8}}};

struct UlogField {
  UlogType type = UlogType::u8;
  std::size_t at = 0;  // in the body of a data message, after the topic's number
};

struct UlogTopic {
  std::string name;
  std::map<std::string, UlogField, std::less<>> fields;  // elements of arrays as "q[0]"
};

// "float[4] q": type, number of elements, name.
struct UlogDeclaration {
  std::string type;
  std::size_t count = 1;
  std::string name;
};

std::vector<UlogDeclaration> parse_ulog_fields(std::string_view text) {
  std::vector<UlogDeclaration> fields;
  while (!text.empty()) {
    const std::size_t end = text.find(';');
    std::string_view field = text.substr(0, end);
    text = end == std::string_view::npos ? std::string_view() : text.substr(end + 1);
    const std::size_t blank = field.find(' ');
    if (blank == std::string_view::npos) continue;
    UlogDeclaration declaration{std::string(field.substr(0, blank)), 1, std::string(field.substr(blank + 1))};
    if (const std::size_t bracket = declaration.type.find('['); bracket != std::string::npos) {
      const char* from = declaration.type.data() + bracket + 1;
      const auto [at, error] =
          std::from_chars(from, declaration.type.data() + declaration.type.size(), declaration.count);
      if (error != std::errc{} || *at != ']' || declaration.count == 0 || declaration.count > kMaxTopicBytes) return {};
      declaration.type.resize(bracket);
    }
    fields.push_back(std::move(declaration));
  }
  return fields;
}

class UlogFormats {
 public:
  void add(std::string name, std::vector<UlogDeclaration> fields) {
    if (formats_.size() < kMaxFormats) formats_.insert_or_assign(std::move(name), std::move(fields));
  }

  // Nothing for a topic without a format, or one that is too large, too deep, or contains itself.
  std::optional<UlogTopic> topic(const std::string& name) const {
    UlogTopic topic{.name = name, .fields = {}};
    Placing placing;
    if (!place(name, "", 0, placing, topic)) return std::nullopt;
    return topic;
  }

 private:
  struct Placing {
    std::size_t at = 0;
    std::size_t steps = 0;  // formats within formats, which may be empty: bounded by themselves
  };

  bool place(const std::string& format, const std::string& prefix, int depth, Placing& placing,
             UlogTopic& topic) const {
    auto& at = placing.at;
    const auto found = formats_.find(format);
    if (found == formats_.end() || depth > kMaxNesting || ++placing.steps > kMaxTopicFields) return false;
    for (const UlogDeclaration& field : found->second) {
      const auto basic = std::find_if(kUlogBasics.begin(), kUlogBasics.end(),
                                      [&](const UlogBasic& one) { return one.name == field.type; });
      const bool plain = basic != kUlogBasics.end();
      if (plain && (field.type == "char" || field.name.starts_with("_padding"))) {  // texts are of no use here
        at += field.count * basic->size;
      } else {
        for (std::size_t i = 0; i < field.count; ++i) {
          const std::string name = prefix + (field.count == 1 ? field.name : fmt::format("{}[{}]", field.name, i));
          if (plain) {
            if (topic.fields.size() >= kMaxTopicFields) return false;
            topic.fields.emplace(name, UlogField{basic->type, at});
            at += basic->size;
          } else if (!place(field.type, name + ".", depth + 1, placing, topic)) {
            return false;
          }
          if (at > kMaxTopicBytes) return false;
        }
      }
      if (at > kMaxTopicBytes) return false;
    }
    return true;
  }

  std::map<std::string, std::vector<UlogDeclaration>> formats_;
};

class UlogData {
 public:
  UlogData(const UlogTopic& topic, ByteView body) : topic_(topic), body_(body) {}

  std::optional<double> number(std::string_view name) const {
    const auto found = topic_.fields.find(name);
    if (found == topic_.fields.end()) return std::nullopt;
    const auto& [type, at] = found->second;
    const auto read = [this, at = at]<class Number>(Number) -> std::optional<double> {
      if (at + sizeof(Number) > body_.size()) return std::nullopt;
      return static_cast<double>(little_endian<Number>(body_, at));
    };
    switch (type) {
      case UlogType::i8: return read(std::int8_t{});
      case UlogType::u8: return read(std::uint8_t{});
      case UlogType::i16: return read(std::int16_t{});
      case UlogType::u16: return read(std::uint16_t{});
      case UlogType::i32: return read(std::int32_t{});
      case UlogType::u32: return read(std::uint32_t{});
      case UlogType::i64: return read(std::int64_t{});
      case UlogType::u64: return read(std::uint64_t{});
      case UlogType::f32: return read(float{});
      case UlogType::f64: return read(double{});
    }
    return std::nullopt;
  }
  double number_or_nan(std::string_view name) const { return number(name).value_or(std::nan("")); }
  bool is_set(std::string_view name) const { return number(name).value_or(0) != 0; }

 private:
  const UlogTopic& topic_;
  ByteView body_;
};

class UlogInterpreter {
 public:
  UlogInterpreter() : builder_("PX4 ULog") {}

  LogBuilder& builder() { return builder_; }

  static bool wants(std::string_view topic) {
    constexpr std::array<std::string_view, 9> kWanted{
        "vehicle_attitude",       "vehicle_gps_position",    "sensor_gps",
        "vehicle_local_position", "vehicle_global_position", "distance_sensor",
        "camera_capture",         "camera_trigger",          "sensor_combined"};
    return std::find(kWanted.begin(), kWanted.end(), topic) != kWanted.end();
  }

  void take(const UlogTopic& topic, ByteView body) {
    const UlogData data(topic, body);
    const auto us = data.number("timestamp");
    if (!us || !builder_.take_time(*us * 1e-6)) return;
    const double time_s = *us * 1e-6;
    if (topic.name == "vehicle_attitude") {
      take_attitude(time_s, data);
    } else if (topic.name == "sensor_combined") {
      builder_.inertial(time_s, vector_of(data, "gyro_rad"), vector_of(data, "accelerometer_m_s2"));
    } else if (topic.name == "vehicle_gps_position" || topic.name == "sensor_gps") {
      gps_from_fused_ = gps_from_fused_ || topic.name == "vehicle_gps_position";
      if (topic.name == "vehicle_gps_position" || !gps_from_fused_) take_gps(time_s, data);
    } else if (topic.name == "vehicle_local_position") {
      if (data.number("z_valid").value_or(1) != 0) {
        builder_.height(&FlightLog::home_heights, time_s, -data.number_or_nan("z"));
      }
      if (data.is_set("dist_bottom_valid")) {
        builder_.height(&FlightLog::terrain_heights, time_s, data.number_or_nan("dist_bottom"));
      }
    } else if (topic.name == "vehicle_global_position") {
      builder_.height(&FlightLog::msl_heights, time_s, data.number_or_nan("alt"));
    } else if (topic.name == "distance_sensor") {
      take_distance(time_s, data);
    } else if (topic.name == "camera_capture") {
      if (data.number("result").value_or(1) == 1) builder_.trigger(time_s);
    } else if (topic.name == "camera_trigger" && !data.is_set("feedback")) {
      builder_.commanded_trigger(time_s);
    }
  }

  FlightLog finish() { return builder_.finish(); }

 private:
  static Eigen::Vector3d vector_of(const UlogData& data, std::string_view name) {
    const auto axis = [&](int i) { return data.number_or_nan(fmt::format("{}[{}]", name, i)); };
    return {axis(0), axis(1), axis(2)};
  }

  void take_attitude(double time_s, const UlogData& data) {
    const double w = data.number_or_nan("q[0]"), x = data.number_or_nan("q[1]"), y = data.number_or_nan("q[2]"),
                 z = data.number_or_nan("q[3]");
    const double norm = w * w + x * x + y * y + z * z;
    if (!(std::abs(norm - 1) < 0.05)) return;  // NaN as well
    builder_.attitude(time_s, std::atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
                      std::asin(std::clamp(2 * (w * y - z * x), -1.0, 1.0)),
                      std::atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)));
  }

  void take_gps(double time_s, const UlogData& data) {
    constexpr double kFix3d = 3;
    if (!(data.number_or_nan("fix_type") >= kFix3d)) return;
    if (const auto lat_deg = data.number("latitude_deg")) {
      builder_.position(time_s, {data.number_or_nan("longitude_deg"), *lat_deg}, data.number_or_nan("altitude_msl_m"));
    } else {
      builder_.position(time_s, {data.number_or_nan("lon") * 1e-7, data.number_or_nan("lat") * 1e-7},
                        data.number_or_nan("alt") * 1e-3);
    }
    if (const auto utc_us = data.number("time_utc_usec")) builder_.utc(time_s, *utc_us * 1e-6);
  }

  void take_distance(double time_s, const UlogData& data) {
    constexpr double kDown = 25;
    if (data.number("orientation").value_or(kDown) != kDown) return;
    if (data.number("signal_quality").value_or(1) == 0) return;
    const double distance_m = data.number_or_nan("current_distance");
    if (!(distance_m > 0)) return;
    if (distance_m < data.number("min_distance").value_or(0)) return;
    if (distance_m > data.number("max_distance").value_or(1e9)) return;
    builder_.height(&FlightLog::ranges, time_s, distance_m);
  }

  LogBuilder builder_;
  bool gps_from_fused_ = false;
};

class UlogReader {
 public:
  explicit UlogReader(LogStream& stream) : stream_(stream) {}

  FlightLog read() {
    stream_.skip(kUlogHeader);
    FlightLog& log = interpreter_.builder().log();
    bool lost = false;
    while (!stream_.at_end() && !interpreter_.builder().restarted()) {
      if (!appended_.empty() && stream_.position() >= appended_.front()) appended_.erase(appended_.begin());
      const ByteView head = stream_.peek(kMessageHead);
      if (head.size() < kMessageHead) {
        log.truncated = true;
        break;
      }
      const std::size_t size = little_endian<std::uint16_t>(head, 0);
      const char type = static_cast<char>(head[2]);
      const bool known = std::string_view("BFIMPQARDLCSO").find(type) != std::string_view::npos;
      if (!known || (size == 0 && type != 'S')) {
        if (!lost) ++log.damaged;
        lost = true;
        ++log.skipped_bytes;
        stream_.skip(1);
        continue;
      }
      const std::uint64_t end = stream_.position() + kMessageHead + size;
      if (!appended_.empty() && end > appended_.front()) {  // cut off by a crash; more was appended behind it
        stream_.seek(appended_.front());
        continue;
      }
      if (end > stream_.size()) {
        log.truncated = true;
        break;
      }
      lost = false;
      ++log.records;
      take(type, stream_.peek(kMessageHead + size).subspan(kMessageHead));
      stream_.seek(end);
    }
    return interpreter_.finish();
  }

 private:
  void take(char type, ByteView body) {
    if (type == 'B') take_flags(body);
    if (type == 'F') {
      const std::string_view text = as_text(body);
      const std::size_t colon = text.find(':');
      if (colon != std::string_view::npos) {
        formats_.add(std::string(text.substr(0, colon)), parse_ulog_fields(text.substr(colon + 1)));
      }
    }
    if (type == 'A' && body.size() > 3) {
      const std::uint16_t number = little_endian<std::uint16_t>(body, 1);
      const std::string name(as_text(body.subspan(3)));
      topics_.erase(number);
      // The first instance alone, but of distance sensors, of which any may look down.
      if (!UlogInterpreter::wants(name) || (body[0] != 0 && name != "distance_sensor")) return;
      if (auto topic = formats_.topic(name)) topics_.emplace(number, std::move(*topic));
    }
    if (type == 'R' && body.size() >= 2) topics_.erase(little_endian<std::uint16_t>(body, 0));
    if (type == 'D' && body.size() > 2) {
      const auto topic = topics_.find(little_endian<std::uint16_t>(body, 0));
      if (topic != topics_.end()) interpreter_.take(topic->second, body.subspan(2));
    }
  }

  void take_flags(ByteView body) {
    constexpr std::size_t kCompatible = 8, kIncompatible = 8, kOffsets = 3;
    if (body.size() < kCompatible + kIncompatible + kOffsets * 8) return;
    const std::uint8_t first = body[kCompatible];
    bool others = (first & ~1U) != 0;
    for (std::size_t i = 1; i < kIncompatible; ++i) others = others || body[kCompatible + i] != 0;
    if (others) {
      throw UsageError({.what = "this ULog needs a newer reader",
                        .where = stream_.name(),
                        .expected = "no incompatible flags but of appended data",
                        .found = "unknown incompatible flags",
                        .fix = "use a newer release of Nadir"});
    }
    if ((first & 1U) == 0) return;
    for (std::size_t i = 0; i < kOffsets; ++i) {
      const auto offset = little_endian<std::uint64_t>(body, kCompatible + kIncompatible + i * 8);
      if (offset > stream_.position() && offset < stream_.size()) appended_.push_back(offset);
    }
    std::sort(appended_.begin(), appended_.end());
  }

  LogStream& stream_;
  UlogFormats formats_;
  std::map<std::uint16_t, UlogTopic> topics_;
  std::vector<std::uint64_t> appended_;  // where data begin that were appended later, in order
  UlogInterpreter interpreter_;
};

}  // namespace

bool is_px4_log(LogStream& stream) {
  const ByteView head = stream.peek(kUlogHeader);
  return head.size() == kUlogHeader && std::equal(kUlogMagic.begin(), kUlogMagic.end(), head.begin());
}

FlightLog read_px4_log(LogStream& stream) {
  if (!is_px4_log(stream)) {
    throw UsageError({.what = "this is no PX4 log",
                      .where = stream.name(),
                      .expected = "a .ulg file, which begins with \"ULog\" and its version",
                      .found = stream.size() == 0 ? "an empty file" : "other bytes",
                      .fix = "download the log from the autopilot again"});
  }
  return UlogReader(stream).read();
}

}  // namespace nadir
