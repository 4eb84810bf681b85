// Roads, water, woods and buildings from files as OpenStreetMap, Geofabrik and GIS programs have them.
#include "package_build/vector_source.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ogrsf_frmts.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "package/vector_layer.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

// A square of 2 km around 11.5, 48.1, at zoom 18: pixels of 0.4 m.
Mission mission() {
  Mission mission;
  mission.takeoff = {11.5, 48.1};
  mission.zoom = {15, 18};
  mission.sectors.push_back(
      {"s", SectorClass::active, {{11.49, 48.09}, {11.51, 48.09}, {11.51, 48.11}, {11.49, 48.11}}});
  return mission;
}

std::string feature(const std::string& tags, const std::string& type, const std::string& coordinates) {
  return fmt::format(R"({{"type":"Feature","properties":{{{}}},"geometry":{{"type":"{}","coordinates":{}}}}})", tags,
                     type, coordinates);
}
std::string square(double lon, double lat, double side = 0.001) {
  return fmt::format("[[{0},{1}],[{2},{1}],[{2},{3}],[{0},{3}],[{0},{1}]]", lon, lat, lon + side, lat + side);
}

class VectorSource : public testing::Test {
 protected:
  fs::path geojson(const std::vector<std::string>& features, const std::string& name = "in.geojson") {
    std::string text = R"({"type":"FeatureCollection","features":[)";
    for (const std::string& one : features) text += (&one == &features.front() ? "" : ",") + one;
    folder_.write(name, text + "]}");
    return folder_ / name;
  }
  VectorLayer cut(const fs::path& file, const Mission& for_mission = mission()) {
    vectors_ = cut_vectors({file, "the surveyors", "CC-BY-4.0"}, for_mission, findings_);
    return parse_vectors(as_bytes(vectors_.text), "vectors");
  }
  static std::vector<std::string> names(const VectorLayer& layer) {
    std::vector<std::string> names;
    for (const MapVector& vector : layer.features) {
      names.push_back(fmt::format("{} {}{}", name_of(vector.cls), vector.kind, vector.is_area ? " area" : ""));
    }
    return names;
  }
  static std::string refusal(const std::function<void()>& call) {
    try {
      call();
    } catch (const Error& error) {
      return error.what();
    }
    return "accepted";
  }

  test::TemporaryFolder folder_;
  PackageVectors vectors_;
  Findings findings_;
};

TEST_F(VectorSource, TagsDecide) {
  const std::string line = "[[11.5,48.1],[11.503,48.1]]";
  const VectorLayer layer = cut(geojson({
      feature(R"("highway":"primary")", "LineString", line),
      feature(R"("highway":"proposed")", "LineString", line),
      feature(R"("highway":"service","tunnel":"yes")", "LineString", line),
      feature(R"("railway":"rail")", "LineString", "[[11.5,48.101],[11.503,48.101]]"),
      feature(R"("railway":"abandoned")", "LineString", line),
      feature(R"("waterway":"river")", "LineString", "[[11.5,48.102],[11.503,48.102]]"),
      feature(R"("waterway":"river","tunnel":"culvert")", "LineString", line),
      feature(R"("natural":"water","water":"lake")", "Polygon", "[" + square(11.5, 48.1) + "]"),
      feature(R"("landuse":"reservoir")", "Polygon", "[" + square(11.502, 48.1) + "]"),
      feature(R"("natural":"wood")", "Polygon", "[" + square(11.504, 48.1) + "]"),
      feature(R"("landuse":"forest")", "MultiPolygon", "[[" + square(11.505, 48.102) + "]]"),
      feature(R"("building":"yes")", "Polygon", "[" + square(11.501, 48.105, 0.0002) + "]"),
      feature(R"("building":"no")", "Polygon", "[" + square(11.5, 48.1) + "]"),
      feature(R"("landuse":"farmland")", "Polygon", "[" + square(11.5, 48.1) + "]"),
      feature(R"("other_tags":"\"name\"=>\"A \\\"quoted\\\" lake\",\"water\"=>\"pond\"")", "Polygon",
              "[" + square(11.506, 48.1) + "]"),
      feature(R"("highway":"bus_stop")", "Point", "[11.5,48.1]"),
  }));
  EXPECT_THAT(names(layer), testing::ElementsAre("wood forest area", "wood wood area", "water lake area",
                                                 "water pond area", "water reservoir area", "water river",
                                                 "building yes area", "road primary", "road rail"));
  EXPECT_TRUE(findings_.empty());
  EXPECT_EQ(vectors_.facts.roads, 2U);
  EXPECT_EQ(vectors_.facts.water, 4U);
  EXPECT_EQ(vectors_.facts.woods, 2U);
  EXPECT_EQ(vectors_.facts.buildings, 1U);
  EXPECT_EQ(vectors_.facts.attribution, "the surveyors");
  EXPECT_EQ(layer.licence, "CC-BY-4.0");
  EXPECT_EQ(vectors_.facts.source_sha256, sha256_file(folder_ / "in.geojson"));
}

TEST_F(VectorSource, IsCutToTheMissionAndSimplifiedToItsPixels) {
  std::string wavy = "[";
  for (int i = 0; i <= 400; ++i) {  // a straight line with waves of 10 cm
    wavy += fmt::format("{}[{:.8f},{:.8f}]", i == 0 ? "" : ",", 11.3 + i * 0.001, 48.1 + (i % 2) * 1e-6);
  }
  const VectorLayer layer =
      cut(geojson({feature(R"("highway":"primary")", "LineString", wavy + "]"),
                   feature(R"("natural":"wood")", "Polygon", "[" + square(11.0, 48.0, 1.0) + "]"),
                   feature(R"("building":"shed")", "Polygon", "[" + square(11.5, 48.1, 2e-6) + "]"),
                   feature(R"("highway":"track")", "LineString", "[[12,48.1],[12.1,48.1]]")}));
  ASSERT_THAT(names(layer), testing::ElementsAre("wood wood area", "road primary"));
  const std::vector<LonLat>& road = layer.features[1].parts.front();
  EXPECT_LE(road.size(), 3U);
  // 250 m beyond the sector, as its tiles.
  const double metre = 1 / (111'320 * std::cos(48.1 * 3.14159265 / 180));
  EXPECT_NEAR(std::min(road.front().lon_deg, road.back().lon_deg), 11.49 - 250 * metre, 3 * metre);
  EXPECT_NEAR(std::max(road.front().lon_deg, road.back().lon_deg), 11.51 + 250 * metre, 3 * metre);
  double north = 0;
  for (const LonLat& corner : layer.features[0].parts.front()) north = std::max(north, corner.lat_deg);
  EXPECT_NEAR(north, 48.11 + 250 / 111'200.0, 1e-4);
}

TEST_F(VectorSource, ACorridorIsNotItsBoundingBox) {
  Mission diagonal = mission();
  diagonal.sectors.clear();
  diagonal.route.corridor_half_width_m = 60;
  diagonal.route.points = {{11.5, 48.1}, {11.55, 48.15}};
  const VectorLayer layer =
      cut(geojson({feature(R"("building":"in")", "Polygon", "[" + square(11.525, 48.125, 0.0003) + "]"),
                   feature(R"("building":"out")", "Polygon", "[" + square(11.545, 48.105, 0.0003) + "]")}),
          diagonal);
  EXPECT_THAT(names(layer), testing::ElementsAre("building in area"));
}

TEST_F(VectorSource, HolesAndBrokenRingsSurvive) {
  const VectorLayer layer =
      cut(geojson({feature(R"("natural":"water")", "Polygon",
                           "[" + square(11.495, 48.1, 0.004) + "," + square(11.496, 48.101) + "]"),
                   // a bow tie
                   feature(R"("natural":"wood")", "Polygon",
                           "[[[11.505,48.1],[11.507,48.102],[11.507,48.1],[11.505,48.102],[11.505,48.1]]]")}));
  ASSERT_THAT(names(layer), testing::ElementsAre("wood wood area", "wood wood area", "water water area"));
  EXPECT_EQ(layer.features[2].parts.size(), 2U);
}

// The same features through other drivers.
TEST_F(VectorSource, AGeoPackageInAnotherProjectionGivesTheSamePlaces) {
  register_gdal_drivers();
  OGRSpatialReference utm, wgs84;
  utm.importFromEPSG(32632);
  wgs84.importFromEPSG(4326);
  wgs84.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  const std::unique_ptr<OGRCoordinateTransformation> to_utm(OGRCreateCoordinateTransformation(&wgs84, &utm));
  {
    const GdalHandle out(GetGDALDriverManager()->GetDriverByName("GPKG")->Create((folder_ / "in.gpkg").c_str(), 0, 0, 0,
                                                                                 GDT_Unknown, nullptr));
    ASSERT_TRUE(out);
    // Geofabrik's layers.
    for (const auto& [name, fclass, area] : {std::tuple("gis_osm_roads_free_1", "residential", false),
                                             {"gis_osm_water_a_free_1", "wetland", true},
                                             {"gis_osm_water_a_free_1b", "water", true},
                                             {"gis_osm_landuse_a_free_1", "forest", true},
                                             {"gis_osm_buildings_a_free_1", "building", true}}) {
      OGRLayer* layer = out->CreateLayer(name, &utm, area ? wkbPolygon : wkbLineString, nullptr);
      ASSERT_NE(layer, nullptr);
      OGRFieldDefn field("fclass", OFTString);
      ASSERT_EQ(layer->CreateField(&field), OGRERR_NONE);
      OGRFeature row(layer->GetLayerDefn());
      row.SetField("fclass", fclass);
      OGRLinearRing ring;
      for (const auto& [x, y] : {std::pair(11.5, 48.1), {11.501, 48.1}, {11.501, 48.101}, {11.5, 48.1}})
        ring.addPoint(x, y);
      OGRPolygon polygon;
      polygon.addRing(&ring);
      OGRLineString line;
      line.addPoint(11.5, 48.1), line.addPoint(11.502, 48.102);
      OGRGeometry& shape = area ? static_cast<OGRGeometry&>(polygon) : line;
      ASSERT_EQ(shape.transform(to_utm.get()), OGRERR_NONE);
      row.SetGeometry(&shape);
      ASSERT_EQ(layer->CreateFeature(&row), OGRERR_NONE);
    }
  }
  const VectorLayer layer = cut(folder_ / "in.gpkg");
  ASSERT_THAT(names(layer), testing::ElementsAre("wood forest area", "water water area", "building building area",
                                                 "road residential"));
  EXPECT_NEAR(layer.features[3].parts[0][0].lon_deg, 11.5, 2e-7);
  EXPECT_NEAR(layer.features[3].parts[0][1].lat_deg, 48.102, 2e-7);
}

// OpenStreetMap's own formats, with a way, a closed way and a multipolygon.
constexpr const char* kOsm = R"(<?xml version="1.0" encoding="UTF-8"?>
<osm version="0.6" generator="by hand">
 <node id="1" lat="48.1" lon="11.5" version="1"/><node id="2" lat="48.1" lon="11.503" version="1"/>
 <node id="3" lat="48.103" lon="11.503" version="1"/><node id="4" lat="48.103" lon="11.5" version="1"/>
 <way id="10" version="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/></way>
 <way id="11" version="1"><nd ref="1"/><nd ref="2"/><nd ref="3"/><nd ref="1"/><tag k="building" v="barn"/></way>
 <way id="12" version="1"><nd ref="1"/><nd ref="2"/><nd ref="3"/></way>
 <way id="13" version="1"><nd ref="3"/><nd ref="4"/><nd ref="1"/></way>
 <relation id="20" version="1"><member type="way" ref="12" role="outer"/><member type="way" ref="13" role="outer"/>
  <tag k="type" v="multipolygon"/><tag k="natural" v="water"/><tag k="water" v="basin"/></relation>
</osm>)";

TEST_F(VectorSource, OpenStreetMapsFilesBringTheirLicence) {
  folder_.write("a.osm", kOsm);
  vectors_ = cut_vectors({folder_ / "a.osm", {}, {}}, mission(), findings_);
  EXPECT_EQ(vectors_.facts.attribution, "© OpenStreetMap contributors");
  EXPECT_EQ(vectors_.facts.licence, "ODbL-1.0");
  EXPECT_THAT(names(parse_vectors(as_bytes(vectors_.text), "vectors")),
              testing::ElementsAre("water basin area", "building barn area", "road residential"));
}

// Protocol buffers, as the PBF format lays them: two blobs, a header and dense nodes with ways, uncompressed.
class Pbf {
 public:
  Pbf& varint(int field, std::uint64_t value) { return tag(field, 0).raw(value); }
  Pbf& bytes(int field, const std::string& value) {
    tag(field, 2).raw(value.size());
    text += value;
    return *this;
  }
  static std::string packed(const std::vector<std::int64_t>& values, bool zigzag) {
    Pbf list;
    for (const std::int64_t v : values)
      list.raw(zigzag ? (static_cast<std::uint64_t>(v) << 1) ^ static_cast<std::uint64_t>(v >> 63)
                      : static_cast<std::uint64_t>(v));
    return list.text;
  }
  static std::string blob(const std::string& type, const std::string& content) {
    Pbf data, header;
    data.bytes(1, content);
    header.bytes(1, type).varint(3, data.text.size());
    const auto size = static_cast<std::uint32_t>(header.text.size());
    std::string out;
    for (int shift = 24; shift >= 0; shift -= 8) out += static_cast<char>(size >> shift & 0xFF);
    return out + header.text + data.text;
  }
  std::string text;

 private:
  Pbf& tag(int field, int type) {
    return raw(static_cast<std::uint64_t>(field) << 3 | static_cast<std::uint64_t>(type));
  }
  Pbf& raw(std::uint64_t value) {
    for (; value > 0x7F; value >>= 7) text += static_cast<char>((value & 0x7F) | 0x80);
    text += static_cast<char>(value);
    return *this;
  }
};

std::string sample_pbf() {
  Pbf header;
  header.bytes(4, "OsmSchema-V0.6").bytes(4, "DenseNodes");
  Pbf strings;
  for (const char* word : {"", "highway", "residential", "natural", "water"}) strings.bytes(1, word);
  // In units of 100 nanodegrees: 11.5, 48.1 and two more; each relative to the one before.
  Pbf dense;
  dense.bytes(1, Pbf::packed({1, 1, 1}, true))
      .bytes(8, Pbf::packed({481'000'000, 0, 30'000}, true))
      .bytes(9, Pbf::packed({115'000'000, 30'000, 0}, true));
  Pbf road, lake;
  road.varint(1, 10)
      .bytes(2, Pbf::packed({1}, false))
      .bytes(3, Pbf::packed({2}, false))
      .bytes(8, Pbf::packed({1, 1}, true));
  lake.varint(1, 11)
      .bytes(2, Pbf::packed({3}, false))
      .bytes(3, Pbf::packed({4}, false))
      .bytes(8, Pbf::packed({1, 1, 1, -2}, true));
  Pbf nodes, ways, block;
  nodes.bytes(2, dense.text);
  ways.bytes(3, road.text).bytes(3, lake.text);
  block.bytes(1, strings.text).bytes(2, nodes.text).bytes(2, ways.text);
  return Pbf::blob("OSMHeader", header.text) + Pbf::blob("OSMData", block.text);
}

TEST_F(VectorSource, AnOsmPbfIsRead) {
  folder_.write("region.osm.pbf", sample_pbf());
  vectors_ = cut_vectors({folder_ / "region.osm.pbf", {}, {}}, mission(), findings_);
  const VectorLayer layer = parse_vectors(as_bytes(vectors_.text), "vectors");
  ASSERT_THAT(names(layer), testing::ElementsAre("water water area", "road residential"));
  EXPECT_EQ(layer.features[1].parts[0][1], (LonLat{11.503, 48.1}));
  // Damaged ones are refused, or give less; never anything else.
  const std::string sound = sample_pbf();
  for (std::size_t cut = 1; cut < sound.size(); cut += 5) {
    folder_.write("cut.osm.pbf", sound.substr(0, cut));
    refusal([&] { cut_vectors({folder_ / "cut.osm.pbf", {}, {}}, mission(), findings_); });
  }
}

TEST_F(VectorSource, SameFileSameBytes) {
  const std::vector<std::string> features{
      feature(R"("highway":"primary")", "LineString", "[[11.4,48.0],[11.6,48.2]]"),
      feature(R"("natural":"wood")", "Polygon", "[" + square(11.49, 48.09, 0.03) + "]")};
  cut(geojson(features));
  const std::string first = vectors_.text;
  cut(geojson({features[1], features[0]}, "other.geojson"));
  EXPECT_EQ(vectors_.text, first);
}

TEST_F(VectorSource, WhatIsNotKnownOrNotThereIsSaid) {
  const fs::path file = geojson({feature(R"("highway":"primary")", "LineString", "[[10,47],[10.1,47]]")});
  const std::string licence = refusal([&] { cut_vectors({file, {}, {}}, mission(), findings_); });
  EXPECT_NE(licence.find("--vectors-licence ODbL-1.0"), std::string::npos) << licence;
  EXPECT_NE(refusal([&] {
              cut_vectors({file, "us", {}}, mission(), findings_);
            }).find("no licence"),
            std::string::npos);
  EXPECT_NE(refusal([&] {
              cut_vectors({file, std::string(300, 'x'), "MIT"}, mission(), findings_);
            }).find("too long"),
            std::string::npos);
  EXPECT_TRUE(findings_.empty());
  cut(file);
  ASSERT_TRUE(findings_.contains("vectors.elsewhere"));
  EXPECT_FALSE(findings_.has_errors());
  EXPECT_NE(findings_.items().front().found.find("10.0000,47.0000"), std::string::npos);

  EXPECT_NE(refusal([&] { cut(folder_ / "missing.osm.pbf"); }).find("no such file"), std::string::npos);
  EXPECT_NE(refusal([&] { cut("/vsicurl/http://example.org/a.geojson"); }).find("no such file"), std::string::npos);
  folder_.write("text.geojson", "not JSON");
  EXPECT_NE(refusal([&] { cut(folder_ / "text.geojson"); }).find("cannot be read"), std::string::npos);
  folder_.write("map.vrt", "<OGRVRTDataSource/>");
  EXPECT_NE(refusal([&] { cut(folder_ / "map.vrt"); }).find("cannot be read"), std::string::npos);
}

}  // namespace
}  // namespace nadir
