#include "package_build/vector_source.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>
#include <ogrsf_frmts.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

#include "base/digest.hpp"
#include "base/files.hpp"
#include "geodesy/region.hpp"
#include "geodesy/web_mercator.hpp"
#include "object_storage/object_address.hpp"
#include "package/vector_layer.hpp"
#include "package_build/build_plan.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace {

using GeometryPtr = std::unique_ptr<OGRGeometry>;

constexpr const char* kOsmAttribution = "© OpenStreetMap contributors";
constexpr const char* kOsmLicence = "ODbL-1.0";
constexpr int kBufferSegments = 8;  // of a quarter of a circle around a corner of the area

// The tags of a feature, wherever its file keeps them.
class FeatureTags {
 public:
  explicit FeatureTags(const OGRFeature& feature) : feature_(feature), rest_(hstore(column("other_tags"))) {}

  std::string get(const char* key) const {
    if (std::string value = column(key); !value.empty()) return value;
    const auto found = rest_.find(key);
    return found == rest_.end() ? std::string() : found->second;
  }
  bool is_one_of(const char* key, std::initializer_list<std::string_view> values) const {
    const std::string value = get(key);
    return std::find(values.begin(), values.end(), value) != values.end();
  }

 private:
  std::string column(const char* name) const {
    const int index = feature_.GetFieldIndex(name);
    return index >= 0 && feature_.IsFieldSetAndNotNull(index) ? feature_.GetFieldAsString(index) : "";
  }

  // "key"=>"value","key"=>"value", with \" and \\ inside.
  static std::map<std::string, std::string, std::less<>> hstore(std::string_view text) {
    std::map<std::string, std::string, std::less<>> tags;
    std::array<std::string, 2> pair;
    std::size_t which = 0;
    bool inside = false;
    for (std::size_t i = 0; i < text.size(); ++i) {
      const char c = text[i];
      if (inside && c == '\\' && i + 1 < text.size()) {
        pair[which] += text[++i];
      } else if (c == '"') {
        inside = !inside;
        if (inside) continue;
        if (which == 1) tags.emplace(std::exchange(pair[0], {}), std::exchange(pair[1], {}));
        which = 1 - which;
      } else if (inside) {
        pair[which] += c;
      }
    }
    return tags;
  }

  const OGRFeature& feature_;
  std::map<std::string, std::string, std::less<>> rest_;
};

struct Classified {
  VectorClass cls = VectorClass::road;
  std::string kind;
};

bool is_hidden(const FeatureTags& tags) {
  const std::string tunnel = tags.get("tunnel");
  return (!tunnel.empty() && tunnel != "no") || tags.get("location") == "underground";
}

// As Geofabrik's extracts have it: one layer for each theme, and the value of the tag in "fclass".
std::optional<Classified> classified_extract(const std::string& fclass, std::string_view layer, bool is_area) {
  const auto is = [&](std::string_view theme) { return layer.find(theme) != std::string_view::npos; };
  const auto one_of = [&](std::initializer_list<std::string_view> values) {
    return std::find(values.begin(), values.end(), fclass) != values.end();
  };
  if (!is_area && (is("_roads") || is("_railways"))) return Classified{VectorClass::road, fclass};
  if (!is_area && is("_waterways")) return Classified{VectorClass::water, fclass};
  if (!is_area) return std::nullopt;
  if (is("_water_a") && one_of({"water", "reservoir", "river", "riverbank", "dock"}))
    return Classified{VectorClass::water, fclass};
  if (is("_landuse_a") && fclass == "forest") return Classified{VectorClass::wood, fclass};
  if (is("_buildings_a")) return Classified{VectorClass::building, fclass};
  return std::nullopt;
}

std::optional<Classified> classified_line(const FeatureTags& tags) {
  if (is_hidden(tags)) return std::nullopt;
  const std::string highway = tags.get("highway"), railway = tags.get("railway"), waterway = tags.get("waterway");
  const bool no_road = tags.is_one_of(
      "highway", {"proposed", "construction", "abandoned", "razed", "platform", "corridor", "elevator", "no"});
  if (!highway.empty() && !no_road) return Classified{VectorClass::road, highway};
  const bool no_track = tags.is_one_of(
      "railway", {"proposed", "construction", "abandoned", "razed", "dismantled", "platform", "subway", "no"});
  if (!railway.empty() && !no_track) return Classified{VectorClass::road, railway};
  if (tags.is_one_of("waterway", {"river", "canal", "stream", "drain", "ditch"}))
    return Classified{VectorClass::water, waterway};
  return std::nullopt;
}

std::optional<Classified> classified_area(const FeatureTags& tags) {
  if (is_hidden(tags)) return std::nullopt;
  if (tags.get("natural") == "water" || !tags.get("water").empty()) {
    const std::string kind = tags.get("water");
    return Classified{VectorClass::water, kind.empty() ? "water" : kind};
  }
  if (tags.is_one_of("waterway", {"riverbank", "dock"})) return Classified{VectorClass::water, tags.get("waterway")};
  if (tags.is_one_of("landuse", {"reservoir", "basin"})) return Classified{VectorClass::water, tags.get("landuse")};
  if (tags.get("natural") == "wood") return Classified{VectorClass::wood, "wood"};
  if (tags.get("landuse") == "forest") return Classified{VectorClass::wood, "forest"};
  if (const std::string building = tags.get("building"); !building.empty() && building != "no")
    return Classified{VectorClass::building, building};
  return std::nullopt;
}

// The sectors and the corridor with the margin of the tiles, in the local plane.
GeometryPtr area_of(const Region& region) {
  OGRMultiPolygon parts;
  const auto add = [&](const OGRGeometry& geometry, double distance_m) {
    const GeometryPtr buffered(geometry.Buffer(distance_m, kBufferSegments));
    if (!buffered) return;
    if (wkbFlatten(buffered->getGeometryType()) == wkbPolygon) parts.addGeometry(buffered.get());
    if (wkbFlatten(buffered->getGeometryType()) == wkbMultiPolygon) {
      for (const OGRPolygon* part : *buffered->toMultiPolygon()) parts.addGeometry(part);
    }
  };
  for (const PlaneRing& ring : region.rings) {
    OGRLinearRing outline;
    for (const PlanePoint& point : ring) outline.addPoint(point.east_m, point.north_m);
    outline.closeRings();
    OGRPolygon polygon;
    polygon.addRing(&outline);
    add(polygon, kMargin_m);
  }
  for (const Corridor& corridor : region.corridors) {
    OGRLineString path;
    for (const PlanePoint& point : corridor.path) path.addPoint(point.east_m, point.north_m);
    add(path, corridor.half_width_m + kMargin_m);
  }
  return GeometryPtr(parts.UnionCascaded());
}

// Cuts, simplifies and rounds geometries in WGS 84, and collects what is left of them.
class VectorCutter {
 public:
  explicit VectorCutter(const Mission& mission)
      : frame_(mission_frame(mission)),
        pixel_m_(ground_resolution_m(mission.zoom.max, mission.takeoff.lat_deg)),
        area_(area_of(required_region(mission, frame_))) {
    if (!area_) throw Error({.what = "the mission's area cannot be built", .found = QuietGdal::last_error()});
    prepared_ = OGRCreatePreparedGeometry(OGRGeometry::ToHandle(area_.get()));
    OGREnvelope plane;
    area_->getEnvelope(&plane);
    // The sides of the plane's box are curves in degrees: its corners and the middles of its sides bound it well
    // enough, because the area has a margin.
    for (const double east_m : {plane.MinX, (plane.MinX + plane.MaxX) / 2, plane.MaxX}) {
      for (const double north_m : {plane.MinY, (plane.MinY + plane.MaxY) / 2, plane.MaxY}) {
        const LonLat place = frame_.lonlat_from_plane({east_m, north_m});
        box_.Merge(place.lon_deg, place.lat_deg);
      }
    }
  }
  ~VectorCutter() { OGRDestroyPreparedGeometry(prepared_); }
  VectorCutter(const VectorCutter&) = delete;
  VectorCutter& operator=(const VectorCutter&) = delete;

  const OGREnvelope& box() const { return box_; }
  std::vector<MapVector> take() { return std::move(vectors_); }

  void add(const OGRGeometry& wgs84, const Classified& as) {
    switch (wkbFlatten(wgs84.getGeometryType())) {
      case wkbLineString:
        if (as.cls == VectorClass::road || as.cls == VectorClass::water) cut(*line_in_plane(*wgs84.toLineString()), as);
        break;
      case wkbPolygon:
        if (as.cls != VectorClass::road) cut(*polygon_in_plane(*wgs84.toPolygon()), as);
        break;
      case wkbMultiLineString:
      case wkbMultiPolygon:
      case wkbGeometryCollection:
        for (const OGRGeometry* part : *wgs84.toGeometryCollection()) add(*part, as);
        break;
      default: break;
    }
  }

 private:
  void copy_points(const OGRSimpleCurve& from, OGRSimpleCurve& to) const {
    for (int i = 0; i < from.getNumPoints(); ++i) {
      const PlanePoint point = frame_.plane_from_lonlat({from.getX(i), from.getY(i)});
      to.addPoint(point.east_m, point.north_m);
    }
  }
  std::unique_ptr<OGRLineString> line_in_plane(const OGRLineString& line) const {
    auto plane = std::make_unique<OGRLineString>();
    copy_points(line, *plane);
    return plane;
  }
  std::unique_ptr<OGRPolygon> polygon_in_plane(const OGRPolygon& polygon) const {
    auto plane = std::make_unique<OGRPolygon>();
    for (const OGRLinearRing* ring : polygon) {
      OGRLinearRing copied;
      copy_points(*ring, copied);
      copied.closeRings();
      plane->addRing(&copied);
    }
    return plane;
  }

  void cut(const OGRGeometry& plane, const Classified& as) {
    const auto handle = OGRGeometry::ToHandle(const_cast<OGRGeometry*>(&plane));
    if (!OGRPreparedGeometryIntersects(prepared_, handle)) return;
    GeometryPtr sound(plane.IsValid() ? plane.clone() : plane.MakeValid());
    if (!sound) return;
    GeometryPtr inside(OGRPreparedGeometryContains(prepared_, handle) ? sound.release()
                                                                      : sound->Intersection(area_.get()));
    if (!inside) return;
    const GeometryPtr simple(inside->SimplifyPreserveTopology(pixel_m_));
    keep(simple ? *simple : *inside, as);
  }

  void keep(const OGRGeometry& plane, const Classified& as) {
    switch (wkbFlatten(plane.getGeometryType())) {
      case wkbLineString: {
        if (as.cls != VectorClass::road && as.cls != VectorClass::water) break;  // an area that was only touched
        const OGRLineString& line = *plane.toLineString();
        if (line.get_Length() < pixel_m_) break;
        std::vector<LonLat> points = places_of(line, false);
        if (points.size() > 1) put({as.cls, as.kind, false, {std::move(points)}});
        break;
      }
      case wkbPolygon: keep_polygon(*plane.toPolygon(), as); break;
      case wkbMultiLineString:
      case wkbMultiPolygon:
      case wkbGeometryCollection:
        for (const OGRGeometry* part : *plane.toGeometryCollection()) keep(*part, as);
        break;
      default: break;
    }
  }

  // RFC 7946: the outer ring counter-clockwise, holes clockwise.
  void keep_polygon(const OGRPolygon& polygon, const Classified& as) {
    MapVector vector{as.cls, as.kind, true, {}};
    for (const OGRLinearRing* ring : polygon) {
      const bool outer = vector.parts.empty();
      std::vector<LonLat> points;
      if (ring->get_Area() >= pixel_m_ * pixel_m_) points = places_of(*ring, ring->isClockwise() == (outer ? 1 : 0));
      constexpr std::size_t kLeastRing = 4;
      if (points.size() >= kLeastRing) {
        vector.parts.push_back(std::move(points));
      } else if (outer) {
        return;
      }
    }
    if (!vector.parts.empty()) put(std::move(vector));
  }

  std::vector<LonLat> places_of(const OGRSimpleCurve& curve, bool reversed) const {
    std::vector<LonLat> places;
    const auto rounded = [](double deg) { return std::round(deg * 1e7) / 1e7; };
    for (int k = 0; k < curve.getNumPoints(); ++k) {
      const int i = reversed ? curve.getNumPoints() - 1 - k : k;
      const LonLat exact = frame_.lonlat_from_plane({curve.getX(i), curve.getY(i)});
      const LonLat place{rounded(exact.lon_deg), rounded(exact.lat_deg)};
      if (places.empty() || places.back() != place) places.push_back(place);
    }
    return places;
  }

  void put(MapVector vector) {
    if (vectors_.size() >= kMaxVectorFeatures) {
      throw UsageError({.what = "there are too many vectors in the mission's area",
                        .expected = fmt::format("at most {} features", kMaxVectorFeatures),
                        .found = "more",
                        .fix = "leave buildings out of the file"});
    }
    vectors_.push_back(std::move(vector));
  }

  LocalFrame frame_;
  double pixel_m_;
  GeometryPtr area_;
  OGRPreparedGeometry* prepared_ = nullptr;
  OGREnvelope box_;  // of the area, in degrees
  std::vector<MapVector> vectors_;
};

// Reads the features of a file one after the other, in the order that its driver needs.
class VectorReader {
 public:
  VectorReader(std::string where, VectorCutter& cutter) : where_(std::move(where)), cutter_(cutter) {
    wgs84_.importFromEPSG(4326);
    wgs84_.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  }

  void read(GDALDataset& dataset) {
    const QuietGdal quiet;
    for (OGRLayer* layer : dataset.GetLayers()) prepare(*layer);
    CPLErrorReset();
    dataset.ResetReading();
    OGRLayer* layer = nullptr;
    while (OGRFeature* next = dataset.GetNextFeature(&layer, nullptr, nullptr, nullptr)) {
      const OGRFeatureUniquePtr feature(next);
      if (layer != nullptr && feature->GetGeometryRef() != nullptr) take(*feature, *layer);
    }
    if (CPLGetLastErrorType() >= CE_Failure) {
      throw Error({.what = "the vectors are damaged",
                   .where = where_,
                   .found = QuietGdal::last_error(),
                   .fix = "get the file again, or check it with `ogrinfo`"});
    }
  }

  const OGREnvelope& seen() const { return seen_; }  // of everything that counts, in degrees

 private:
  struct LayerFacts {
    std::string name;
    bool georeferenced = false;
    std::unique_ptr<OGRCoordinateTransformation> to_wgs84;  // null: it is
  };

  void prepare(OGRLayer& layer) {
    LayerFacts facts{layer.GetName(), layer.GetSpatialRef() != nullptr, nullptr};
    const bool same = facts.georeferenced && layer.GetSpatialRef()->IsSame(&wgs84_) != 0;
    if (facts.georeferenced && !same) {
      facts.to_wgs84.reset(OGRCreateCoordinateTransformation(layer.GetSpatialRef(), &wgs84_));
      if (!facts.to_wgs84) facts.georeferenced = false;
    }
    layers_[&layer] = std::move(facts);
  }

  void take(const OGRFeature& feature, const OGRLayer& layer) {
    const LayerFacts& facts = layers_.at(&layer);
    const GeometryPtr geometry(feature.GetGeometryRef()->getLinearGeometry());
    if (!geometry) return;
    const auto as = classified(feature, facts.name, geometry->getDimension() == 2);
    if (!as) return;
    if (!facts.georeferenced) {
      throw UsageError({.what = "the vectors are not georeferenced",
                        .where = fmt::format("{}: {}", where_, facts.name),
                        .expected = "a coordinate reference system",
                        .fix = "set one: ogr2ogr -a_srs EPSG:… OUT.gpkg IN"});
    }
    if (facts.to_wgs84 && geometry->transform(facts.to_wgs84.get()) != OGRERR_NONE) return;
    OGREnvelope envelope;
    geometry->getEnvelope(&envelope);
    const bool on_earth = envelope.MinX >= -180 && envelope.MaxX <= 180 && envelope.MinY >= -90 && envelope.MaxY <= 90;
    if (!on_earth) return;  // NaN as well
    seen_.Merge(envelope);
    if (cutter_.box().Intersects(envelope)) cutter_.add(*geometry, *as);
  }

  static std::optional<Classified> classified(const OGRFeature& feature, std::string_view layer, bool is_area) {
    const FeatureTags tags(feature);
    std::optional<Classified> as;
    if (const std::string fclass = tags.get("fclass"); !fclass.empty()) {
      as = classified_extract(fclass, layer, is_area);
    } else {
      as = is_area ? classified_area(tags) : classified_line(tags);
    }
    if (as && as->kind.size() > kMaxVectorKind) as->kind.resize(kMaxVectorKind);
    return as;
  }

  std::string where_;
  VectorCutter& cutter_;
  OGRSpatialReference wgs84_;
  std::map<const OGRLayer*, LayerFacts> layers_;
  OGREnvelope seen_;
};

GdalHandle open_vectors(const std::filesystem::path& file) {
  register_gdal_drivers();
  if (is_remote_name(file.string()) || !std::filesystem::is_regular_file(file)) {
    throw UsageError({.what = "no such file of vectors",
                      .where = file.string(),
                      .expected = "a file on this machine",
                      .fix = "download it first"});
  }
  constexpr std::array<const char*, 7> kDrivers{"OSM",        "GPKG", "GeoJSON", "GeoJSONSeq", "ESRI Shapefile",
                                                "FlatGeobuf", nullptr};
  const QuietGdal quiet;
  GdalHandle dataset(
      GDALDataset::Open(file.c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR, kDrivers.data()));
  if (dataset) return dataset;
  throw UsageError({.what = "the vectors cannot be read",
                    .where = file.string(),
                    .expected = ".osm.pbf, .osm, GeoPackage, GeoJSON, Shapefile or FlatGeobuf",
                    .found = QuietGdal::last_error(),
                    .fix = "check the file with `ogrinfo`"});
}

bool is_osm(GDALDataset& dataset) {
  return dataset.GetDriver() != nullptr && std::string_view(dataset.GetDriver()->GetDescription()) == "OSM";
}

VectorOrigin origin_of(const VectorRequest& request, GDALDataset& dataset) {
  VectorOrigin origin{request.attribution.value_or(""), request.licence.value_or("")};
  if (is_osm(dataset)) {
    if (origin.attribution.empty()) origin.attribution = kOsmAttribution;
    if (origin.licence.empty()) origin.licence = kOsmLicence;
  }
  if (origin.attribution.empty() || origin.licence.empty()) {
    throw UsageError({.what = "whose data these vectors are, and under which licence, is not known",
                      .where = request.file.string(),
                      .expected = "--vectors-attribution TEXT and --vectors-licence ID, an SPDX identifier",
                      .found = origin.attribution.empty() && origin.licence.empty() ? "neither"
                               : origin.licence.empty()                             ? "no licence"
                                                                                    : "no attribution",
                      .fix = fmt::format("for OpenStreetMap's data: --vectors-attribution \"{}\" --vectors-licence {}",
                                         kOsmAttribution, kOsmLicence)});
  }
  for (const auto& [text, most] :
       {std::pair(&origin.attribution, kMaxAttribution), {&origin.licence, std::size_t{64}}}) {
    if (text->size() <= most) continue;
    throw UsageError({.what = "the attribution or licence of the vectors is too long",
                      .where = request.file.string(),
                      .expected = fmt::format("at most {} bytes", most),
                      .found = fmt::format("{} bytes", text->size())});
  }
  return origin;
}

}  // namespace

VectorOrigin origin_of(const VectorRequest& request) { return origin_of(request, *open_vectors(request.file)); }

PackageVectors cut_vectors(const VectorRequest& request, const Mission& mission, Findings& findings) {
  const GdalHandle dataset = open_vectors(request.file);
  const VectorOrigin origin = origin_of(request, *dataset);
  const QuietGdal quiet;
  VectorCutter cutter(mission);
  VectorReader reader(request.file.string(), cutter);
  reader.read(*dataset);
  VectorLayer layer{origin.attribution, origin.licence, cutter.take()};

  PackageVectors vectors;
  vectors.text = vectors_geojson(layer);
  if (vectors.text.size() > kMaxVectors_bytes) {
    throw UsageError({.what = "there are too many vectors in the mission's area",
                      .where = request.file.string(),
                      .expected = fmt::format("at most {} MB", kMaxVectors_bytes / 1'000'000),
                      .found = fmt::format("{} MB", vectors.text.size() / 1'000'000),
                      .fix = "leave buildings out of the file"});
  }
  if (layer.features.empty()) {
    const OGREnvelope& seen = reader.seen();
    findings.add({.code = "vectors.elsewhere",
                  .severity = Severity::warning,
                  .where = request.file.string(),
                  .expected = fmt::format("roads, water, woods or buildings near {:.4f},{:.4f}",
                                          mission.takeoff.lon_deg, mission.takeoff.lat_deg),
                  .found = seen.IsInit() ? fmt::format("some from {:.4f},{:.4f} to {:.4f},{:.4f}", seen.MinX, seen.MinY,
                                                       seen.MaxX, seen.MaxY)
                                         : std::string("none in the whole file"),
                  .fix = "give a file of this place, with OpenStreetMap's tags"});
  }
  // As they stand in the file, each once.
  const VectorLayer written = parse_vectors(as_bytes(vectors.text), kVectorsFile);
  const auto of = [&](VectorClass cls) {
    return static_cast<std::uint64_t>(std::count_if(written.features.begin(), written.features.end(),
                                                    [cls](const MapVector& vector) { return vector.cls == cls; }));
  };
  vectors.facts = {origin.attribution,     origin.licence,        sha256_file(request.file), of(VectorClass::road),
                   of(VectorClass::water), of(VectorClass::wood), of(VectorClass::building)};
  return vectors;
}

}  // namespace nadir
