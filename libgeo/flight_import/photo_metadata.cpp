#include "flight_import/photo_metadata.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <exiv2/exiv2.hpp>
#include <map>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "base/input_file.hpp"
#include "base/printable.hpp"
#include "base/time.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr std::uint64_t kMaxTiffWithExif = std::uint64_t{1} << 29;  // read as a whole: its directory may be at the end

struct MetadataSegments {
  Bytes exif, xmp;
};

// The segments of a JPEG before its pixels.
MetadataSegments jpeg_metadata(const InputFile& file) {
  constexpr std::string_view kExif{"Exif\0\0", 6}, kXmp{"http://ns.adobe.com/xap/1.0/\0", 29};
  constexpr int kMaxSegments = 4096;  // thermal cameras store raw data in hundreds of them
  constexpr std::uint8_t kApp1 = 0xE1, kStartOfScan = 0xDA, kEndOfImage = 0xD9;
  MetadataSegments found;
  std::uint64_t at = 2;
  for (int i = 0; i < kMaxSegments; ++i) {
    std::array<std::uint8_t, 4> head{};
    if (at + head.size() > file.size() || !file.read_at(at, head) || head[0] != 0xFF) break;
    if (head[1] == 0xFF) {  // padding
      ++at;
      continue;
    }
    if (head[1] == kStartOfScan || head[1] == kEndOfImage) break;
    const std::size_t size = std::size_t{head[2]} << 8 | head[3];
    if (size < 2) break;
    if (head[1] == kApp1) {
      Bytes body(size - 2);
      if (!file.read_at(at + 4, body)) break;
      const std::string_view text = as_text(body);
      if (found.exif.empty() && text.starts_with(kExif)) found.exif.assign(body.begin() + kExif.size(), body.end());
      if (found.xmp.empty() && text.starts_with(kXmp)) found.xmp.assign(body.begin() + kXmp.size(), body.end());
    }
    at += 2 + size;
  }
  return found;
}

MetadataSegments metadata_of(const std::filesystem::path& path) {
  const InputFile file(path);
  std::array<std::uint8_t, 4> head{};
  if (file.size() < head.size() || !file.read_at(0, head)) return {};
  if (head[0] == 0xFF && head[1] == 0xD8) return jpeg_metadata(file);
  if (is_tiff(head) && file.size() <= kMaxTiffWithExif) return {file.read(kMaxTiffWithExif), {}};
  return {};
}

// exiv2 keeps a registry of XMP names and prints warnings; both are set up once.
void prepare_exiv2() {
  static const bool ready = [] {
    Exiv2::LogMsg::setLevel(Exiv2::LogMsg::mute);
    return Exiv2::XmpParser::initialize();
  }();
  static_cast<void>(ready);
}

using Texts = std::map<std::string, std::string, std::less<>>;

std::optional<std::string> text_of(const Texts& texts, std::string_view key) {
  const auto found = texts.find(key);
  if (found == texts.end()) return std::nullopt;
  std::string text = found->second;
  while (!text.empty() && (text.back() == ' ' || text.back() == '\0')) text.pop_back();
  return text.empty() ? std::nullopt : std::optional(text);
}

std::optional<double> number_in(std::string_view text) {
  if (text.starts_with('+')) text.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || !std::isfinite(value)) return std::nullopt;
  if (end == text.data() + text.size()) return value;
  if (*end != '/') return std::nullopt;  // "361/100"
  const auto divisor = number_in(text.substr(static_cast<std::size_t>(end - text.data()) + 1));
  if (!divisor || *divisor == 0) return std::nullopt;
  return value / *divisor;
}

std::optional<double> number_of(const Texts& texts, std::string_view key) {
  const auto text = text_of(texts, key);
  return text ? number_in(*text) : std::nullopt;
}

std::optional<double> number_between(const Texts& texts, std::string_view key, double low, double high) {
  const auto value = number_of(texts, key);
  return value && *value >= low && *value <= high ? value : std::nullopt;
}

// Numbers separated by blanks or commas.
std::vector<double> numbers_in(std::string_view text) {
  std::vector<double> values;
  while (!text.empty() && values.size() < 64) {
    const std::size_t end = std::min(text.find_first_of(" ,"), text.size());
    if (end > 0) {
      const auto value = number_in(text.substr(0, end));
      if (!value) return {};
      values.push_back(*value);
    }
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return values;
}

// "2016:06:23 16:31:59" as if it were UTC.
std::optional<double> wall_clock_s(std::string text) {
  if (text.size() < 19 || text[4] != ':' || text[7] != ':') return std::nullopt;
  text.resize(19);
  text[4] = text[7] = '-';
  text[10] = 'T';
  const auto time = parse_utc(text + "Z");
  if (!time || time->unix_s < 315'532'800) return std::nullopt;  // 1980: the clock was never set
  return static_cast<double>(time->unix_s);
}

// "+02:00"
std::optional<double> zone_seconds(std::string_view text) {
  if (text == "Z") return 0;
  if (text.size() < 6 || text[3] != ':' || (text[0] != '+' && text[0] != '-')) return std::nullopt;
  const auto hours = number_in(text.substr(1, 2)), minutes = number_in(text.substr(4, 2));
  if (!hours || !minutes || *hours > 14 || *minutes > 59) return std::nullopt;
  return (text[0] == '-' ? -60 : 60) * (*hours * 60 + *minutes);
}

std::optional<double> sexagesimal_deg(const Texts& exif, const char* key, const char* reference, char negative,
                                      double limit) {
  const auto text = text_of(exif, key);
  const auto parts = text ? numbers_in(*text) : std::vector<double>();
  const auto side = text_of(exif, reference);
  if (parts.size() != 3 || !side) return std::nullopt;
  const double value = parts[0] + parts[1] / 60 + parts[2] / 3600;
  if (!(value >= 0 && value <= limit)) return std::nullopt;
  return side->front() == negative ? -value : value;
}

void set_times(const Texts& exif, const Texts& xmp, PhotoFacts& facts) {
  constexpr const char* kTime = "Exif.Photo.DateTimeOriginal";
  const bool original = exif.contains(kTime);
  auto time = text_of(exif, original ? kTime : "Exif.Photo.DateTimeDigitized");
  if (!time) time = text_of(exif, "Exif.Image.DateTime");
  if (time) facts.camera_s = wall_clock_s(*time);
  if (facts.camera_s) {
    const auto fraction = text_of(exif, original ? "Exif.Photo.SubSecTimeOriginal" : "Exif.Photo.SubSecTimeDigitized");
    if (fraction && fraction->size() <= 9 && fraction->find_first_not_of("0123456789") == std::string::npos) {
      facts.clock_step_s = std::pow(10, -static_cast<double>(fraction->size()));
      *facts.camera_s += *number_in(*fraction) * facts.clock_step_s;
    }
    const char* offset = original ? "Exif.Photo.OffsetTimeOriginal" : "Exif.Photo.OffsetTimeDigitized";
    if (const auto zone = text_of(exif, offset)) facts.zone_s = zone_seconds(*zone);
  }
  if (const auto exposure = text_of(xmp, "UTCAtExposure"); exposure && exposure->size() >= 19) {
    facts.utc_s = wall_clock_s(*exposure);
    if (facts.utc_s && exposure->size() > 20) {
      *facts.utc_s += number_in("0" + exposure->substr(19)).value_or(0);
    }
  }
  const auto date = text_of(exif, "Exif.GPSInfo.GPSDateStamp");
  const auto clock = text_of(exif, "Exif.GPSInfo.GPSTimeStamp");
  if (!facts.utc_s && date && clock) {
    const auto parts = numbers_in(*clock);
    const auto day_s = wall_clock_s(*date + " 00:00:00");
    if (day_s && parts.size() == 3 && parts[0] < 24 && parts[1] < 60 && parts[2] < 61) {
      facts.utc_s = *day_s + parts[0] * 3600 + parts[1] * 60 + parts[2];
    }
  }
}

// "2022-06-08;fx,fy,cx,cy,k1,k2,p1,p2,k3" with the principal point from the middle of the image.
void set_calibration(const Texts& xmp, PhotoFacts& facts) {
  facts.calibrated_focal_px = number_between(xmp, "CalibratedFocalLength", 10, 100'000);
  const auto text = text_of(xmp, "DewarpData");
  if (!text) return;
  const std::size_t begin = text->find(';');
  const auto values = begin == std::string::npos ? std::vector<double>() : numbers_in(text->substr(begin + 1));
  if (values.size() != 9 || !(values[0] > 10) || !(values[1] > 10)) return;
  CameraModel camera;
  camera.fx = values[0];
  camera.fy = values[1];
  camera.cx = values[2];  // the middle is added when the size is known
  camera.cy = values[3];
  const bool straightened = number_of(xmp, "DewarpFlag").value_or(0) == 1;
  if (!straightened) std::copy(values.begin() + 4, values.end(), camera.distortion.begin());
  facts.calibration = camera;
}

void set_camera(const Texts& exif, const Texts& xmp, PhotoFacts& facts) {
  facts.make = printable(text_of(exif, "Exif.Image.Make").value_or(""));
  facts.model = printable(text_of(exif, "Exif.Image.Model").value_or(""));
  facts.focal_mm = number_between(exif, "Exif.Photo.FocalLength", 0.1, 5000);
  facts.focal_35mm = number_between(exif, "Exif.Photo.FocalLengthIn35mmFilm", 1, 5000);
  const auto resolution = number_between(exif, "Exif.Photo.FocalPlaneXResolution", 1e-3, 1e9);
  const double unit = number_of(exif, "Exif.Photo.FocalPlaneResolutionUnit").value_or(2);
  const double unit_mm = unit == 2 ? 25.4 : unit == 3 ? 10 : unit == 4 ? 1 : unit == 5 ? 1e-3 : 0;
  if (resolution && unit_mm > 0) facts.sensor_px_per_mm = *resolution / unit_mm;
  set_calibration(xmp, facts);
}

std::optional<Attitude> attitude_of(const Texts& xmp, const char* yaw, const char* pitch, const char* roll) {
  const auto yaw_deg = number_between(xmp, yaw, -360, 360);
  const auto pitch_deg = number_between(xmp, pitch, -180, 180);
  if (!yaw_deg || !pitch_deg) return std::nullopt;
  return Attitude{radians(*yaw_deg), radians(*pitch_deg), radians(number_between(xmp, roll, -180, 180).value_or(0))};
}

void set_pose(const Texts& exif, const Texts& xmp, PhotoFacts& facts) {
  facts.relative_altitude_m = number_between(xmp, "RelativeAltitude", -1000, 20'000);
  facts.absolute_altitude_m = number_between(xmp, "AbsoluteAltitude", -1000, 20'000);
  if (!facts.absolute_altitude_m) {
    facts.absolute_altitude_m = number_between(exif, "Exif.GPSInfo.GPSAltitude", 0, 20'000);
    const double below = number_of(exif, "Exif.GPSInfo.GPSAltitudeRef").value_or(0);
    if (facts.absolute_altitude_m && below == 1) *facts.absolute_altitude_m *= -1;
  }
  facts.gimbal = attitude_of(xmp, "GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree");
  if (!facts.gimbal) facts.gimbal = attitude_of(xmp, "CameraYawDegree", "CameraPitchDegree", "CameraRollDegree");
  facts.body = attitude_of(xmp, "Yaw", "Pitch", "Roll");
  facts.body_is_camera = facts.body.has_value();
  if (!facts.body) facts.body = attitude_of(xmp, "FlightYawDegree", "FlightPitchDegree", "FlightRollDegree");
  const auto direction_deg = number_between(exif, "Exif.GPSInfo.GPSImgDirection", 0, 360);
  if (direction_deg && text_of(exif, "Exif.GPSInfo.GPSImgDirectionRef").value_or("T") == "T") {
    facts.image_direction_rad = wrap_pi(radians(*direction_deg));
  }
  const auto lat = sexagesimal_deg(exif, "Exif.GPSInfo.GPSLatitude", "Exif.GPSInfo.GPSLatitudeRef", 'S', 90);
  const auto lon = sexagesimal_deg(exif, "Exif.GPSInfo.GPSLongitude", "Exif.GPSInfo.GPSLongitudeRef", 'W', 180);
  if (lat && lon && !(*lat == 0 && *lon == 0)) facts.gps = LonLat{*lon, *lat};
}

// Values as exiv2 writes them: rationals as "361/100", several separated by blanks.
template <class Data>
void collect(const Data& data, std::string (*key)(const typename Data::const_iterator&), Texts& texts) {
  constexpr long kMaxValue = 4096;  // bytes: larger ones are pictures and maker notes
  for (auto item = data.begin(); item != data.end(); ++item) {
    if (item->size() <= kMaxValue) texts.emplace(key(item), item->toString());
  }
}

}  // namespace

PhotoFacts parse_photo_metadata(ByteView exif_bytes, ByteView xmp_bytes) {
  prepare_exiv2();
  PhotoFacts facts;
  Texts exif, xmp;
  std::string packet(as_text(xmp_bytes));
  try {
    if (!exif_bytes.empty()) {
      Exiv2::ExifData data;
      Exiv2::ExifParser::decode(data, exif_bytes.data(), static_cast<std::uint32_t>(exif_bytes.size()));
      collect<Exiv2::ExifData>(
          data, [](const Exiv2::ExifData::const_iterator& item) { return item->key(); }, exif);
      if (packet.empty()) {  // a TIFF has it in a tag
        const auto tag = data.findKey(Exiv2::ExifKey("Exif.Image.XMLPacket"));
        if (tag != data.end() && tag->size() < (1 << 20)) {
          std::string raw(static_cast<std::size_t>(tag->size()), '\0');
          tag->copy(reinterpret_cast<Exiv2::byte*>(raw.data()), Exiv2::littleEndian);
          packet = std::move(raw);
        }
      }
    }
  } catch (const std::exception& error) {
    facts.problem = printable(error.what());
  }
  try {
    if (!packet.empty()) {
      Exiv2::XmpData data;
      if (Exiv2::XmpParser::decode(data, packet) != 0) facts.problem = "the XMP packet is damaged";
      collect<Exiv2::XmpData>(
          data, [](const Exiv2::XmpData::const_iterator& item) { return item->tagName(); }, xmp);
    }
  } catch (const std::exception& error) {
    facts.problem = printable(error.what());
  }
  set_times(exif, xmp, facts);
  set_camera(exif, xmp, facts);
  set_pose(exif, xmp, facts);
  return facts;
}

PhotoFacts read_photo_facts(const std::filesystem::path& path) {
  const FrameSize size = read_frame_size(path);
  const MetadataSegments segments = metadata_of(path);
  PhotoFacts facts = parse_photo_metadata(segments.exif, segments.xmp);
  facts.file = path;
  facts.size = size;
  if (facts.calibration) {
    CameraModel& camera = *facts.calibration;
    camera.width = size.width;
    camera.height = size.height;
    camera.cx += (size.width - 1) / 2.0;
    camera.cy += (size.height - 1) / 2.0;
    const bool inside = camera.cx > 0 && camera.cy > 0 && camera.cx < size.width && camera.cy < size.height;
    if (!inside) facts.calibration.reset();
  }
  return facts;
}

Attitude nadir_attitude_from_gimbal(const Attitude& gimbal) {
  // A camera that looks ahead is one that looks down, turned up by 90 degrees.
  return camera_attitude(gimbal, {0, kPi / 2, 0});
}

}  // namespace nadir
