#include "package/vector_layer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/json.hpp"
#include "package/manifest.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::array kClasses{VectorClass::wood, VectorClass::water, VectorClass::building, VectorClass::road};
constexpr std::size_t kLeastLine = 2, kLeastRing = 4;  // points
constexpr int kDepth = 9;                              // of the document

// Whole 1e-7 degrees, without trailing zeros.
std::string degrees_text(double degrees) {
  std::string text = fmt::format("{:.7f}", degrees);
  while (text.back() == '0') text.pop_back();
  if (text.back() == '.') text.pop_back();
  return text == "-0" ? "0" : text;
}

std::string points_text(const std::vector<LonLat>& points) {
  std::string text;
  for (const LonLat& point : points) {
    text += fmt::format("{}[{},{}]", text.empty() ? "" : ",", degrees_text(point.lon_deg), degrees_text(point.lat_deg));
  }
  return "[" + text + "]";
}

std::string feature_text(const MapVector& vector) {
  std::string coordinates;
  for (const std::vector<LonLat>& part : vector.parts) {
    coordinates += (coordinates.empty() ? "" : ",") + points_text(part);
  }
  if (vector.is_area) coordinates = "[" + coordinates + "]";
  return fmt::format(
      R"({{"type":"Feature","properties":{{"class":"{}","kind":{}}},"geometry":{{"type":"{}","coordinates":{}}}}})",
      name_of(vector.cls), json(vector.kind).dump(-1, ' ', false, json::error_handler_t::replace),
      vector.is_area ? "Polygon" : "LineString", coordinates);
}

std::vector<LonLat> read_points(const JsonReader& list) {
  std::vector<LonLat> points;
  points.reserve(list.size());
  for (std::size_t i = 0; i < list.size(); ++i) {
    const json& pair = list.value(i);
    const bool plain = pair.is_array() && pair.size() == 2 && pair[0].is_number() && pair[1].is_number();
    if (!plain) list.refuse(i, "[longitude, latitude]");
    const LonLat place{pair[0].get<double>(), pair[1].get<double>()};
    if (!(std::abs(place.lon_deg) <= 180 && std::abs(place.lat_deg) <= 90)) list.refuse(i, "a place on Earth");
    points.push_back(place);
  }
  return points;
}

MapVector read_feature(const JsonReader& in) {
  in.expect("type", "Feature");
  MapVector vector;
  const JsonReader properties = in.object("properties");
  vector.cls = properties.choice("class", kClasses);
  vector.kind = properties.text("kind", {0, kMaxVectorKind});
  properties.finish();
  const JsonReader geometry = in.object("geometry");
  vector.is_area = geometry.choice("type", {"LineString", "Polygon"}) == "Polygon";
  const JsonReader coordinates = geometry.array("coordinates", {vector.is_area ? std::size_t{1} : kLeastLine});
  if (vector.is_area) {
    for (std::size_t i = 0; i < coordinates.size(); ++i) {
      vector.parts.push_back(read_points(coordinates.array(i, {kLeastRing})));
      if (vector.parts.back().front() != vector.parts.back().back()) coordinates.refuse(i, "a ring that is closed");
    }
  } else {
    vector.parts.push_back(read_points(coordinates));
  }
  geometry.finish();
  in.finish();
  return vector;
}

}  // namespace

std::string_view name_of(VectorClass cls) {
  switch (cls) {
    case VectorClass::wood: return "wood";
    case VectorClass::water: return "water";
    case VectorClass::building: return "building";
    case VectorClass::road: return "road";
  }
  return "road";
}

std::string vectors_geojson(const VectorLayer& layer) {
  std::vector<std::pair<VectorClass, std::string>> lines;
  lines.reserve(layer.features.size());
  for (const MapVector& vector : layer.features) lines.emplace_back(vector.cls, feature_text(vector));
  std::sort(lines.begin(), lines.end());
  lines.erase(std::unique(lines.begin(), lines.end()), lines.end());
  const auto quoted = [](const std::string& text) {
    return json(text).dump(-1, ' ', false, json::error_handler_t::replace);
  };
  std::string text = fmt::format(R"({{"type":"FeatureCollection","attribution":{},"licence":{},"features":[)",
                                 quoted(layer.attribution), quoted(layer.licence));
  for (std::size_t i = 0; i < lines.size(); ++i) text += (i == 0 ? "\n" : ",\n") + lines[i].second;
  return text + "\n]}\n";
}

VectorLayer parse_vectors(ByteView file, std::string_view name) {
  if (file.size() > kMaxVectors_bytes) {
    throw Error({.what = "cannot read these vectors",
                 .where = std::string(name),
                 .expected = fmt::format("at most {} bytes", kMaxVectors_bytes),
                 .found = fmt::format("{} bytes", file.size())});
  }
  const json document = parse_json(as_text(file), name, {.max_depth = kDepth, .allow_floats = true});
  const JsonReader in(document, {.name = std::string(name), .what = "cannot read these vectors"});
  in.expect("type", "FeatureCollection");
  VectorLayer layer;
  layer.attribution = in.text("attribution", {1, kMaxAttribution});
  layer.licence = in.text("licence", {1, 64});
  const JsonReader features = in.array("features", {0, kMaxVectorFeatures});
  layer.features.reserve(features.size());
  for (std::size_t i = 0; i < features.size(); ++i) layer.features.push_back(read_feature(features.object(i)));
  in.finish();
  return layer;
}

}  // namespace nadir
