#include "flight_import/sample_photos.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <vector>

#include "base/files.hpp"
#include "imagery/codecs.hpp"

namespace nadir::test {
namespace {

// A directory of TIFF: little-endian, values behind it.
class Ifd {
 public:
  void ascii(std::uint16_t tag, const std::string& text) {
    if (!text.empty()) fields_[tag] = {2, static_cast<std::uint32_t>(text.size() + 1), Bytes(text.begin(), text.end())};
    if (!text.empty()) fields_[tag].values.push_back(0);
  }
  void number16(std::uint16_t tag, std::uint16_t value) { fields_[tag] = {3, 1, raw(value, 2)}; }
  void number32(std::uint16_t tag, std::uint32_t value) { fields_[tag] = {4, 1, raw(value, 4)}; }
  void byte(std::uint16_t tag, std::uint8_t value) { fields_[tag] = {1, 1, {value}}; }
  void rationals(std::uint16_t tag, const std::vector<double>& values) {
    Bytes all;
    for (const double value : values) {
      const Bytes top = raw(static_cast<std::uint64_t>(std::llround(value * 10000)), 4), bottom = raw(10000, 4);
      all.insert(all.end(), top.begin(), top.end());
      all.insert(all.end(), bottom.begin(), bottom.end());
    }
    fields_[tag] = {5, static_cast<std::uint32_t>(values.size()), all};
  }
  bool empty() const { return fields_.empty(); }
  std::uint32_t size() const {
    std::uint32_t size = table_size();
    for (const auto& [tag, field] : fields_) size += field.values.size() > 4 ? even(field.values.size()) : 0;
    return size;
  }
  Bytes write(std::uint32_t at) const {
    Bytes table = raw(fields_.size(), 2), behind;
    for (const auto& [tag, field] : fields_) {
      add(table, raw(tag, 2));
      add(table, raw(field.type, 2));
      add(table, raw(field.count, 4));
      Bytes value = field.values;
      if (value.size() > 4) {
        add(table, raw(at + table_size() + behind.size(), 4));
        value.resize(even(value.size()));
        add(behind, value);
      } else {
        value.resize(4);
        add(table, value);
      }
    }
    add(table, raw(0, 4));
    add(table, behind);
    return table;
  }

 private:
  struct Field {
    std::uint16_t type = 0;
    std::uint32_t count = 0;
    Bytes values;
  };
  static std::uint32_t even(std::size_t size) { return static_cast<std::uint32_t>(size + size % 2); }
  static Bytes raw(std::uint64_t value, int size) {
    Bytes bytes;
    for (int i = 0; i < size; ++i) bytes.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
    return bytes;
  }
  static void add(Bytes& to, const Bytes& more) { to.insert(to.end(), more.begin(), more.end()); }
  std::uint32_t table_size() const { return static_cast<std::uint32_t>(2 + 12 * fields_.size() + 4); }

  std::map<std::uint16_t, Field> fields_;
};

std::vector<double> sexagesimal(double degrees) {
  const double value = std::abs(degrees), whole = std::floor(value), minutes = std::floor((value - whole) * 60);
  return {whole, minutes, ((value - whole) * 60 - minutes) * 60};
}

Bytes segment(std::uint8_t marker, std::string_view head, ByteView body) {
  const std::size_t size = 2 + head.size() + body.size();
  Bytes bytes{0xFF, marker, static_cast<std::uint8_t>(size >> 8), static_cast<std::uint8_t>(size & 0xFF)};
  for (const char c : head) bytes.push_back(static_cast<std::uint8_t>(c));
  for (const std::uint8_t byte : body) bytes.push_back(byte);
  return bytes;
}

}  // namespace

std::string dji_xmp(double relative_m, double yaw_deg, double pitch_deg, double roll_deg, const std::string& more) {
  return fmt::format(
      R"(<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?>
<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description rdf:about="DJI Meta Data" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"
 drone-dji:AbsoluteAltitude="{:+.2f}" drone-dji:RelativeAltitude="{:+.2f}" drone-dji:GimbalRollDegree="{:+.2f}"
 drone-dji:GimbalYawDegree="{:+.2f}" drone-dji:GimbalPitchDegree="{:+.2f}" drone-dji:FlightYawDegree="{:+.2f}"
 drone-dji:FlightPitchDegree="+1.80" drone-dji:FlightRollDegree="+3.00" {}>
</rdf:Description></rdf:RDF></x:xmpmeta><?xpacket end="w"?>)",
      relative_m + 158.5, relative_m, roll_deg, yaw_deg, pitch_deg, yaw_deg, more);
}

Bytes exif_of(const SamplePhoto& photo) {
  Ifd image, exif, gps;
  image.ascii(0x010F, photo.make);
  image.ascii(0x0110, photo.model);
  exif.ascii(0x9003, photo.taken);
  exif.ascii(0x9291, photo.subsec);
  exif.ascii(0x9011, photo.zone);
  if (photo.focal_mm > 0) exif.rationals(0x920A, {photo.focal_mm});
  if (photo.focal_35mm > 0) exif.number16(0xA405, static_cast<std::uint16_t>(photo.focal_35mm));
  if (photo.gps) {
    gps.ascii(0x0001, photo.gps->lat_deg < 0 ? "S" : "N");
    gps.rationals(0x0002, sexagesimal(photo.gps->lat_deg));
    gps.ascii(0x0003, photo.gps->lon_deg < 0 ? "W" : "E");
    gps.rationals(0x0004, sexagesimal(photo.gps->lon_deg));
    gps.byte(0x0005, photo.gps_alt_m < 0 ? 1 : 0);
    gps.rationals(0x0006, {std::abs(photo.gps_alt_m)});
  }
  if (!photo.gps_time.empty()) {
    std::istringstream parts(photo.gps_time);
    std::vector<double> numbers(3);
    for (double& number : numbers) parts >> number;
    gps.rationals(0x0007, numbers);
    gps.ascii(0x001D, photo.gps_date);
  }
  if (photo.image_direction_deg) {
    gps.ascii(0x0010, "T");
    gps.rationals(0x0011, {*photo.image_direction_deg});
  }
  image.number32(0x8769, 0);
  if (!gps.empty()) image.number32(0x8825, 0);
  const std::uint32_t exif_at = 8 + image.size(), gps_at = exif_at + exif.size();
  image.number32(0x8769, exif_at);
  if (!gps.empty()) image.number32(0x8825, gps_at);
  Bytes bytes{'I', 'I', 42, 0, 8, 0, 0, 0};
  for (const Bytes& part : {image.write(8), exif.write(exif_at), gps.empty() ? Bytes() : gps.write(gps_at)}) {
    bytes.insert(bytes.end(), part.begin(), part.end());
  }
  return bytes;
}

Bytes jpeg_with(const cv::Mat& picture, const SamplePhoto& photo) {
  const Bytes plain = encode_image(picture, ImageFormat::jpeg, 90);
  Bytes bytes(plain.begin(), plain.begin() + 2);
  const auto add = [&bytes](const Bytes& more) { bytes.insert(bytes.end(), more.begin(), more.end()); };
  add(segment(0xE1, {"Exif\0\0", 6}, exif_of(photo)));
  if (!photo.xmp.empty()) add(segment(0xE1, {"http://ns.adobe.com/xap/1.0/\0", 29}, as_bytes(photo.xmp)));
  bytes.insert(bytes.end(), plain.begin() + 2, plain.end());
  return bytes;
}

void write_photo(const std::filesystem::path& path, const SamplePhoto& photo, int width, int height) {
  write_file_atomic(path, ByteView(jpeg_with(cv::Mat(height, width, CV_8UC3, cv::Scalar(90, 120, 60)), photo)));
}

SampleGround::SampleGround(int side_px) {
  cv::Mat noise(side_px, side_px, CV_8UC1);
  cv::RNG random(7);
  random.fill(noise, cv::RNG::UNIFORM, 0, 255);
  cv::Mat coarse;
  cv::resize(noise(cv::Rect(0, 0, side_px / 8, side_px / 8)), coarse, noise.size(), 0, 0, cv::INTER_CUBIC);
  cv::GaussianBlur(noise, noise, {}, 2);
  cv::addWeighted(noise, 1.5, coarse, 0.6, -80, ground_);
}

cv::Mat SampleGround::picture(double east_px, double north_px, double heading_deg, cv::Size size) const {
  // Ground column = centre + east, row = centre - north; image right is heading + 90°.
  const double heading = heading_deg * CV_PI / 180, c = std::cos(heading), s = std::sin(heading);
  const double x = (size.width - 1) / 2.0, y = (size.height - 1) / 2.0;
  const double middle_x = ground_.cols / 2.0 + east_px, middle_y = ground_.rows / 2.0 - north_px;
  // From image to ground: right (c, s) and down (-s, c) in ground columns and rows.
  const cv::Mat ground_from_image =
      (cv::Mat_<double>(2, 3) << c, -s, middle_x - c * x + s * y, s, c, middle_y - s * x - c * y);
  cv::Mat picture;
  cv::warpAffine(ground_, picture, ground_from_image, size, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REFLECT);
  return picture;
}

}  // namespace nadir::test
