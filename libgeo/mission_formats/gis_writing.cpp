#include <fmt/format.h>
#include <gdal_priv.h>
#include <ogrsf_frmts.h>
#include <zlib.h>

#include <cpl_conv.h>
#include <map>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "mission_formats/circle_outline.hpp"
#include "mission_formats/gis_files.hpp"
#include "package/mission_yaml.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace {

enum class Shape { point, line, polygon };

struct MissionFeature {
  std::string name;
  Shape shape = Shape::point;
  std::vector<LonLat> points;     // a polygon's without the closing one
  std::vector<double> heights_m;  // of a line, or none
  std::map<std::string, std::string> attributes;
};

// One word for all points, or one for each.
std::string frames_text(const Route& route) {
  std::string text;
  for (const HeightFrame frame : route.height_frames) {
    text += (text.empty() ? "" : " ") + std::string(nadir::name_of(frame));
  }
  return text.empty() ? std::string(nadir::name_of(route.height_frame)) : text;
}

std::vector<MissionFeature> features_of(const Mission& mission) {
  std::vector<MissionFeature> features;
  features.push_back({"take-off",
                      Shape::point,
                      {mission.takeoff},
                      {},
                      {{"nadir_kind", "takeoff"}, {"nadir_mission", mission_yaml(mission)}}});
  if (!mission.route.points.empty()) {
    MissionFeature route{
        "route", Shape::line, mission.route.points, mission.route.heights_m, {{"nadir_kind", "route"}}};
    if (!route.heights_m.empty()) route.attributes["height_frame"] = frames_text(mission.route);
    features.push_back(std::move(route));
  }
  for (const Sector& sector : mission.sectors) {
    features.push_back({sector.id,
                        Shape::polygon,
                        sector.polygon,
                        {},
                        {{"nadir_kind", "sector"},
                         {"class", std::string(name_of(sector.cls))},
                         {"buffer_m", fmt::format("{}", sector.buffer_m)}}});
  }
  for (const NoFlyArea& area : mission.no_fly) {
    MissionFeature feature{area.id, Shape::polygon, area.polygon, {}, {{"nadir_kind", "no_fly"}}};
    if (area.polygon.empty()) {
      feature.points = circle_outline(area.centre, area.radius_m);
      feature.attributes["circle_lon_deg"] = fmt::format("{}", area.centre.lon_deg);
      feature.attributes["circle_lat_deg"] = fmt::format("{}", area.centre.lat_deg);
      feature.attributes["circle_radius_m"] = fmt::format("{}", area.radius_m);
    }
    features.push_back(std::move(feature));
  }
  return features;
}

std::string xml_text(std::string_view text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&': escaped += "&amp;"; break;
      case '<': escaped += "&lt;"; break;
      case '>': escaped += "&gt;"; break;
      case '"': escaped += "&quot;"; break;
      default: escaped += c;
    }
  }
  return escaped;
}

std::string kml_coordinates(const MissionFeature& feature) {
  std::string text;
  for (std::size_t i = 0; i < feature.points.size(); ++i) {
    text += fmt::format("{}{},{}", text.empty() ? "" : " ", feature.points[i].lon_deg, feature.points[i].lat_deg);
    if (!feature.heights_m.empty()) text += fmt::format(",{}", feature.heights_m[i]);
  }
  if (feature.shape == Shape::polygon) {
    text += fmt::format(" {},{}", feature.points.front().lon_deg, feature.points.front().lat_deg);
  }
  return "<coordinates>" + text + "</coordinates>";
}

// Above ground, also where the mission counts from a take-off on flat ground, which is the same there.
const char* altitude_mode(const Mission& mission, const MissionFeature& feature) {
  if (feature.heights_m.empty()) return "clampToGround";
  if (!mission.route.height_frames.empty()) {
    throw UsageError({.what = "KML cannot state heights of different frames in one line",
                      .where = "mission " + mission.id,
                      .expected = "heights above ground or above sea level",
                      .found = height_frames_of(mission.route),
                      .fix = "export as .plan, .waypoints, GeoJSON or GeoPackage"});
  }
  if (mission.route.height_frame == HeightFrame::above_sea_level) return "absolute";
  if (mission.route.height_frame == HeightFrame::above_takeoff && !mission.terrain.flat) {
    throw UsageError({.what = "KML cannot state heights above the take-off point",
                      .where = "mission " + mission.id,
                      .expected = "heights above ground or above sea level, or flat terrain",
                      .found = "above_takeoff over an elevation model",
                      .fix = "export as .plan, .waypoints, GeoJSON or GeoPackage"});
  }
  return "relativeToGround";
}

void put16(Bytes& bytes, unsigned value) {
  bytes.push_back(static_cast<std::uint8_t>(value & 0xFF));
  bytes.push_back(static_cast<std::uint8_t>(value >> 8 & 0xFF));
}

void put32(Bytes& bytes, std::uint64_t value) {
  put16(bytes, static_cast<unsigned>(value & 0xFFFF));
  put16(bytes, static_cast<unsigned>(value >> 16 & 0xFFFF));
}

void put_text(Bytes& bytes, std::string_view text) { bytes.insert(bytes.end(), text.begin(), text.end()); }

}  // namespace

std::string mission_as_kml(const Mission& mission) {
  std::string kml =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\">\n<Document>\n  "
      "<name>" +
      xml_text(mission.id) + "</name>\n";
  for (const MissionFeature& feature : features_of(mission)) {
    kml += "  <Placemark>\n    <name>" + xml_text(feature.name) + "</name>\n    <ExtendedData>\n";
    for (const auto& [key, value] : feature.attributes) {
      kml += fmt::format("      <Data name=\"{}\"><value>{}</value></Data>\n", key, xml_text(value));
    }
    kml += "    </ExtendedData>\n    ";
    switch (feature.shape) {
      case Shape::point: kml += "<Point>" + kml_coordinates(feature) + "</Point>"; break;
      case Shape::line:
        kml += fmt::format("<LineString><altitudeMode>{}</altitudeMode>{}</LineString>",
                           altitude_mode(mission, feature), kml_coordinates(feature));
        break;
      case Shape::polygon:
        kml += "<Polygon><outerBoundaryIs><LinearRing>" + kml_coordinates(feature) +
               "</LinearRing></outerBoundaryIs></Polygon>";
        break;
    }
    kml += "\n  </Placemark>\n";
  }
  return kml + "</Document>\n</kml>\n";
}

// A ZIP archive of one stored file, doc.kml, with the date that stands for none.
Bytes mission_as_kmz(const Mission& mission) {
  const std::string kml = mission_as_kml(mission);
  constexpr std::string_view kName = "doc.kml";
  constexpr unsigned kVersion = 20, kNoTime = 0, kFirstDate = 0x21;  // 1980-01-01
  const auto crc = ::crc32(0, reinterpret_cast<const Bytef*>(kml.data()), static_cast<uInt>(kml.size()));
  const auto common = [&](Bytes& bytes) {
    put16(bytes, kVersion), put16(bytes, 0), put16(bytes, 0), put16(bytes, kNoTime), put16(bytes, kFirstDate);
    put32(bytes, crc), put32(bytes, kml.size()), put32(bytes, kml.size());
    put16(bytes, kName.size()), put16(bytes, 0);
  };
  Bytes zip;
  put32(zip, 0x04034b50);
  common(zip);
  put_text(zip, kName), put_text(zip, kml);
  const std::size_t directory = zip.size();
  put32(zip, 0x02014b50), put16(zip, kVersion);
  common(zip);
  put16(zip, 0), put16(zip, 0), put16(zip, 0), put32(zip, 0), put32(zip, 0);  // comment, disk, attributes, offset
  put_text(zip, kName);
  const std::size_t directory_size = zip.size() - directory;
  put32(zip, 0x06054b50), put16(zip, 0), put16(zip, 0), put16(zip, 1), put16(zip, 1);
  put32(zip, directory_size), put32(zip, directory), put16(zip, 0);
  return zip;
}

std::string mission_as_geojson(const Mission& mission) {
  using nlohmann::ordered_json;
  ordered_json document{{"type", "FeatureCollection"}, {"features", ordered_json::array()}};
  for (const MissionFeature& feature : features_of(mission)) {
    ordered_json coordinates = ordered_json::array();
    for (std::size_t i = 0; i < feature.points.size(); ++i) {
      coordinates.push_back({feature.points[i].lon_deg, feature.points[i].lat_deg});
      if (!feature.heights_m.empty()) coordinates.back().push_back(feature.heights_m[i]);
    }
    ordered_json geometry;
    switch (feature.shape) {
      case Shape::point: geometry = {{"type", "Point"}, {"coordinates", coordinates[0]}}; break;
      case Shape::line: geometry = {{"type", "LineString"}, {"coordinates", coordinates}}; break;
      case Shape::polygon:
        coordinates.push_back(coordinates[0]);
        geometry = {{"type", "Polygon"}, {"coordinates", ordered_json::array({coordinates})}};
        break;
    }
    ordered_json properties{{"name", feature.name}};
    for (const auto& [key, value] : feature.attributes) properties[key] = value;
    document["features"].push_back({{"type", "Feature"}, {"properties", properties}, {"geometry", geometry}});
  }
  return document.dump(1) + "\n";
}

void write_mission_geopackage(const Mission& mission, const std::filesystem::path& path) {
  register_gdal_drivers();
  const QuietGdal quiet;
  const auto require = [&](bool ok) {
    if (!ok)
      throw Error(
          {.what = "the GeoPackage cannot be written", .where = path.string(), .found = QuietGdal::last_error()});
  };
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GPKG");
  require(driver != nullptr);
  // The date of the last change would differ from one run to the next.
  CPLSetThreadLocalConfigOption("OGR_CURRENT_DATE", (to_rfc3339(mission.created).substr(0, 19) + ".000Z").c_str());
  {
    const GdalHandle dataset(driver->Create(path.c_str(), 0, 0, 0, GDT_Unknown, nullptr));
    require(dataset != nullptr);
    OGRSpatialReference wgs84;
    wgs84.importFromEPSG(4326);
    wgs84.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    for (const auto& [name, shape, type] :
         {std::tuple("takeoff", Shape::point, wkbPoint),
          std::tuple("route", Shape::line, mission.route.heights_m.empty() ? wkbLineString : wkbLineString25D),
          std::tuple("areas", Shape::polygon, wkbPolygon)}) {
      OGRLayer* layer = dataset->CreateLayer(name, &wgs84, type, nullptr);
      require(layer != nullptr);
      for (const char* field : {"name", "nadir_kind", "class", "buffer_m", "height_frame", "circle_lon_deg",
                                "circle_lat_deg", "circle_radius_m", "nadir_mission"}) {
        OGRFieldDefn definition(field, OFTString);
        require(layer->CreateField(&definition) == OGRERR_NONE);
      }
      for (const MissionFeature& feature : features_of(mission)) {
        if (feature.shape != shape) continue;
        const std::unique_ptr<OGRFeature> row(OGRFeature::CreateFeature(layer->GetLayerDefn()));
        row->SetField("name", feature.name.c_str());
        for (const auto& [key, value] : feature.attributes) row->SetField(key.c_str(), value.c_str());
        if (shape == Shape::point) {
          OGRPoint point(feature.points[0].lon_deg, feature.points[0].lat_deg);
          row->SetGeometry(&point);
        } else if (shape == Shape::line) {
          OGRLineString line;
          for (std::size_t i = 0; i < feature.points.size(); ++i) {
            const LonLat& at = feature.points[i];
            if (feature.heights_m.empty())
              line.addPoint(at.lon_deg, at.lat_deg);
            else
              line.addPoint(at.lon_deg, at.lat_deg, feature.heights_m[i]);
          }
          row->SetGeometry(&line);
        } else {
          OGRLinearRing ring;
          for (const LonLat& at : feature.points) ring.addPoint(at.lon_deg, at.lat_deg);
          ring.closeRings();
          OGRPolygon polygon;
          polygon.addRing(&ring);
          row->SetGeometry(&polygon);
        }
        require(layer->CreateFeature(row.get()) == OGRERR_NONE);
      }
    }
  }
  CPLSetThreadLocalConfigOption("OGR_CURRENT_DATE", nullptr);
}

}  // namespace nadir
