#include "geodesy/mgrs.hpp"

#include <GeographicLib/MGRS.hpp>
#include <GeographicLib/UTMUPS.hpp>
#include <cmath>

namespace nadir {
namespace {

constexpr int kDigitsOfMetre = 5, kLeastDigits = 2;
constexpr std::size_t kSquareLetters = 2, kMostCharacters = 40;

}  // namespace

std::optional<LonLat> lonlat_from_mgrs(std::string_view text) {
  if (text.size() > kMostCharacters) return std::nullopt;
  std::string reference(text);
  std::erase_if(reference, [](unsigned char c) { return c == ' '; });
  try {
    int zone = 0, digits = 0;
    bool north = false;
    double x_m = 0, y_m = 0;
    LonLat place;
    GeographicLib::MGRS::Reverse(reference, zone, north, x_m, y_m, digits);
    if (digits < kLeastDigits) return std::nullopt;  // "INVALID" gives -2
    GeographicLib::UTMUPS::Reverse(zone, north, x_m, y_m, place.lat_deg, place.lon_deg);
    return place;
  } catch (const GeographicLib::GeographicErr&) {
    return std::nullopt;
  }
}

std::string mgrs_from_lonlat(LonLat place) {
  if (!(std::abs(place.lat_deg) <= 90 && std::abs(place.lon_deg) <= 180)) return {};
  int zone = 0;
  bool north = false;
  double x_m = 0, y_m = 0;
  std::string text;
  GeographicLib::UTMUPS::Forward(place.lat_deg, place.lon_deg, zone, north, x_m, y_m);
  GeographicLib::MGRS::Forward(zone, north, x_m, y_m, place.lat_deg, kDigitsOfMetre, text);
  const std::size_t digits_at = text.size() - 2 * kDigitsOfMetre;
  text.insert(digits_at + kDigitsOfMetre, " ");
  text.insert(digits_at, " ");
  text.insert(digits_at - kSquareLetters, " ");
  return text;
}

}  // namespace nadir
