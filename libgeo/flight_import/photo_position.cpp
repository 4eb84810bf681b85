#include "flight_import/photo_position.hpp"

#include <fmt/format.h>

#include <cmath>
#include <exiv2/exiv2.hpp>

#include "base/error.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

// "48/1 6/1 1234/10000": degrees, minutes, seconds.
std::string sexagesimal(double value_deg) {
  constexpr long kPerSecond = 10'000;
  const long units = std::lround(std::abs(value_deg) * 3600 * kPerSecond);
  const long degrees = units / (3600 * kPerSecond), minutes = units / (60 * kPerSecond) % 60;
  return fmt::format("{}/1 {}/1 {}/{}", degrees, minutes, units % (60 * kPerSecond), kPerSecond);
}

}  // namespace

double radius_68_m(double sigma_m) {
  constexpr double kShare = 0.68;
  return sigma_m * std::sqrt(-2 * std::log(1 - kShare));
}

void write_photo_position(const std::filesystem::path& copy, const PhotoPosition& position) {
  try {
    Exiv2::LogMsg::setLevel(Exiv2::LogMsg::mute);
    const auto image = Exiv2::ImageFactory::open(copy.string());
    image->readMetadata();
    Exiv2::ExifData& exif = image->exifData();
    exif["Exif.GPSInfo.GPSVersionID"] = "2 3 0 0";
    exif["Exif.GPSInfo.GPSLatitude"] = sexagesimal(position.place.lat_deg);
    exif["Exif.GPSInfo.GPSLatitudeRef"] = position.place.lat_deg < 0 ? "S" : "N";
    exif["Exif.GPSInfo.GPSLongitude"] = sexagesimal(position.place.lon_deg);
    exif["Exif.GPSInfo.GPSLongitudeRef"] = position.place.lon_deg < 0 ? "W" : "E";
    exif["Exif.GPSInfo.GPSMapDatum"] = "WGS-84";
    exif["Exif.GPSInfo.GPSProcessingMethod"] = "charset=Ascii MANUAL";
    exif["Exif.GPSInfo.GPSHPositioningError"] = fmt::format("{}/100", std::lround(100 * radius_68_m(position.sigma_m)));
    image->writeMetadata();
  } catch (const std::exception& error) {  // exiv2's, and those of the standard library within it
    throw Error({.what = "the position cannot be written into the photo",
                 .where = copy.string(),
                 .expected = "a JPEG, PNG or TIFF that can be written",
                 .found = printable(error.what())});
  }
}

}  // namespace nadir
