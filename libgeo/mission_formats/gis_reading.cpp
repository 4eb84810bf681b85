#include <cpl_vsi.h>
#include <fmt/format.h>
#include <gdal_priv.h>
#include <ogrsf_frmts.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <memory>

#include "base/number_text.hpp"
#include "base/plural.hpp"
#include "mission_formats/circle_outline.hpp"
#include "mission_formats/gis_files.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace {

constexpr std::size_t kMaxFeatures = 20'000;
constexpr std::size_t kMaxDrawnPoints = 1'000'000;
constexpr int kMaxArchiveEntries = 1000;

class DrawingReader {
 public:
  DrawingReader(std::string where, bool latitude_first, MissionDrawing& drawing)
      : where_(std::move(where)), latitude_first_(latitude_first), drawing_(drawing) {
    wgs84_.importFromEPSG(4326);
    wgs84_.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  }

  void read(GDALDataset& dataset) {
    for (OGRLayer* layer : dataset.GetLayers()) read_layer(*layer);
  }

 private:
  void read_layer(OGRLayer& layer) {
    const OGRSpatialReference* reference = layer.GetSpatialRef();
    std::unique_ptr<OGRCoordinateTransformation> transform;
    // Not even an identity is applied: coordinates stay what the file says, to the last bit.
    const bool is_wgs84 = reference != nullptr && (reference->IsSame(&wgs84_) != 0 || has_code(*reference, "4979") ||
                                                   has_code(*reference, "4326"));
    if (reference != nullptr && !is_wgs84) transform.reset(OGRCreateCoordinateTransformation(reference, &wgs84_));
    const QuietGdal quiet;
    for (const auto& feature : layer) {
      if (++features_ > kMaxFeatures) {
        throw UsageError({.what = "the drawing has too many features",
                          .where = where_,
                          .expected = fmt::format("at most {}", kMaxFeatures),
                          .fix = "keep the route and the areas of one mission"});
      }
      if (feature->GetGeometryRef() == nullptr) continue;
      const std::unique_ptr<OGRGeometry> geometry(feature->GetGeometryRef()->getLinearGeometry());
      if (!geometry) continue;
      if (!is_wgs84 && !transform) {
        throw Error({.what = "the file is not georeferenced",
                     .where = where_,
                     .expected = "a coordinate reference system",
                     .fix = "set one: ogr2ogr -a_srs EPSG:… OUT.geojson IN"});
      }
      add(*geometry, *feature, transform.get());
    }
    if (const std::string message = QuietGdal::last_error(); !message.empty() && CPLGetLastErrorType() >= CE_Failure) {
      throw Error({.what = "the file is damaged", .where = where_, .found = message, .fix = "export it again"});
    }
  }

  static bool has_code(const OGRSpatialReference& reference, const char* code) {
    const char* name = reference.GetAuthorityName(nullptr);
    const char* found = reference.GetAuthorityCode(nullptr);
    return name != nullptr && found != nullptr && std::string_view(name) == "EPSG" && std::string_view(found) == code;
  }

  static std::string text_of(const OGRFeature& feature, const char* field) {
    const int index = feature.GetFieldIndex(field);
    return index >= 0 && feature.IsFieldSetAndNotNull(index) ? feature.GetFieldAsString(index) : "";
  }

  static std::string name_of(const OGRFeature& feature) {
    for (const char* field : {"name", "Name", "NAME", "title", "id"}) {
      if (std::string text = text_of(feature, field); !text.empty()) return text;
    }
    return {};
  }

  std::vector<LonLat> points_of(const OGRSimpleCurve& curve, OGRCoordinateTransformation* transform) {
    points_ += static_cast<std::size_t>(curve.getNumPoints());
    if (points_ > kMaxDrawnPoints) {
      throw UsageError({.what = "the drawing has too many points",
                        .where = where_,
                        .expected = fmt::format("at most {}", kMaxDrawnPoints),
                        .fix = "simplify its lines"});
    }
    std::vector<LonLat> points;
    for (int i = 0; i < curve.getNumPoints(); ++i) points.push_back(place(curve.getX(i), curve.getY(i), transform));
    return points;
  }

  LonLat place(double x, double y, OGRCoordinateTransformation* transform) const {
    if (transform != nullptr && transform->Transform(1, &x, &y) == 0) {
      throw Error(
          {.what = "a point cannot be transformed to WGS 84", .where = where_, .found = QuietGdal::last_error()});
    }
    if (latitude_first_) std::swap(x, y);
    if (!std::isfinite(x) || !std::isfinite(y) || std::abs(x) > 180 || std::abs(y) > 90) {
      const bool swapped = std::isfinite(x) && std::abs(x) <= 90 && std::abs(y) <= 180;
      throw UsageError(
          {.what = "a coordinate is outside of the world",
           .where = where_,
           .expected = "longitudes from -180° to 180°, latitudes from -90° to 90°",
           .found = fmt::format("longitude {}, latitude {}", x, y),
           .fix = swapped ? "longitude and latitude are swapped: correct the file, or import it with --latitude-first"
                          : "correct the file"});
    }
    return {x, y};
  }

  void add(const OGRGeometry& geometry, const OGRFeature& feature, OGRCoordinateTransformation* transform) {
    const std::string kind = text_of(feature, "nadir_kind");
    switch (wkbFlatten(geometry.getGeometryType())) {
      case wkbLineString: add_line(*geometry.toLineString(), feature, transform); break;
      case wkbPolygon: add_polygon(*geometry.toPolygon(), feature, kind, transform); break;
      case wkbPoint:
        if (kind != "takeoff") {
          ++points_left_out_;
          break;
        }
        drawing_.takeoff = place(geometry.toPoint()->getX(), geometry.toPoint()->getY(), transform);
        if (std::string text = text_of(feature, "nadir_mission"); !text.empty())
          drawing_.mission_text = std::move(text);
        break;
      case wkbMultiLineString:
      case wkbMultiPolygon:
      case wkbGeometryCollection:
        for (const OGRGeometry* part : *geometry.toGeometryCollection()) add(*part, feature, transform);
        break;
      default: break;
    }
  }

  void add_line(const OGRLineString& line, const OGRFeature& feature, OGRCoordinateTransformation* transform) {
    DrawnLine drawn{name_of(feature), points_of(line, transform), {}, {}};
    const std::string mode = text_of(feature, "altitudeMode");
    if (line.Is3D() && mode != "clampToGround" && mode != "clampToSeaFloor") {
      for (int i = 0; i < line.getNumPoints(); ++i) drawn.heights_m.push_back(line.getZ(i));
      if (mode == "relativeToGround") drawn.frame = HeightFrame::above_ground;
      if (mode == "absolute") drawn.frame = HeightFrame::above_sea_level;
      take_frames(text_of(feature, "height_frame"), drawn);
      // KML without a mode is clamped to the ground; elsewhere a height of 0 in every point is a drawing program's.
      if (!drawn.frame &&
          std::all_of(drawn.heights_m.begin(), drawn.heights_m.end(), [](double m) { return m == 0; })) {
        drawn.heights_m.clear();
      }
    }
    drawing_.lines.push_back(std::move(drawn));
  }

  // One word for all points, or one for each; where points were added or removed, it is not known which.
  static void take_frames(const std::string& stated, DrawnLine& drawn) {
    std::vector<HeightFrame> frames;
    std::size_t at = 0;
    while (at < stated.size()) {
      const std::size_t end = std::min(stated.find(' ', at), stated.size());
      const std::string_view word = std::string_view(stated).substr(at, end - at);
      for (const HeightFrame frame :
           {HeightFrame::above_ground, HeightFrame::above_takeoff, HeightFrame::above_sea_level}) {
        if (word == nadir::name_of(frame)) frames.push_back(frame);
      }
      at = end + 1;
    }
    if (frames.size() == 1) drawn.frame = frames.front();
    if (frames.size() < 2 || frames.size() != drawn.heights_m.size()) return;
    drawn.frame = frames.front();
    drawn.frames = std::move(frames);
  }

  void add_polygon(const OGRPolygon& polygon, const OGRFeature& feature, const std::string& kind,
                   OGRCoordinateTransformation* transform) {
    DrawnArea area{name_of(feature), AreaKind::unstated, {}, {}, 0};
    if (polygon.getNumInteriorRings() > 0) {
      throw UsageError({.what = "an area has holes",
                        .where = where_ + (area.name.empty() ? "" : ": " + area.name),
                        .expected = "areas with one outline",
                        .found = std::to_string(polygon.getNumInteriorRings()) + " inner rings",
                        .fix = "remove the inner rings, or split the area so that it has none"});
    }
    const OGRLinearRing* ring = polygon.getExteriorRing();
    if (ring == nullptr) return;
    if (kind == "sector") area.kind = AreaKind::sector;
    if (kind == "no_fly") area.kind = AreaKind::no_fly;
    area.polygon = points_of(*ring, transform);
    if (area.polygon.size() > 1 && area.polygon.front() == area.polygon.back()) area.polygon.pop_back();
    take_circle(feature, area);
    drawing_.areas.push_back(std::move(area));
  }

  // A circle is drawn as a polygon. Unless somebody edited that, it is the circle again.
  static void take_circle(const OGRFeature& feature, DrawnArea& area) {
    const auto lon_deg = finite_number(text_of(feature, "circle_lon_deg")),
               lat_deg = finite_number(text_of(feature, "circle_lat_deg")),
               radius_m = finite_number(text_of(feature, "circle_radius_m"));
    if (area.kind != AreaKind::no_fly || !lon_deg || !lat_deg || !radius_m) return;
    const LonLat centre{*lon_deg, *lat_deg};
    if (std::abs(*lon_deg) > 180 || std::abs(*lat_deg) > 85 || *radius_m <= 0 || *radius_m > 200'000) return;
    const std::vector<LonLat> drawn = circle_outline(centre, *radius_m);
    if (drawn.size() != area.polygon.size()) return;
    for (std::size_t i = 0; i < drawn.size(); ++i) {
      if (std::abs(drawn[i].lon_deg - area.polygon[i].lon_deg) > 1e-7) return;
      if (std::abs(drawn[i].lat_deg - area.polygon[i].lat_deg) > 1e-7) return;
    }
    area.polygon.clear();
    area.centre = centre;
    area.radius_m = *radius_m;
  }

 public:
  void finish() {
    if (points_left_out_ > 0) {
      drawing_.notes.add({.code = "import.left_out",
                          .severity = Severity::note,
                          .where = where_,
                          .expected = "lines and areas",
                          .found = count(points_left_out_, "point") + ", which a mission does not have"});
    }
  }

 private:
  std::string where_;
  bool latitude_first_;
  MissionDrawing& drawing_;
  OGRSpatialReference wgs84_;
  std::size_t features_ = 0, points_ = 0, points_left_out_ = 0;
};

MissionDrawing read_with_gdal(const std::string& name, const std::string& where, bool latitude_first) {
  const QuietGdal quiet;
  const GdalHandle dataset(GDALDataset::Open(name.c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR));
  if (!dataset) {
    throw Error({.what = "the file cannot be read",
                 .where = where,
                 .expected = "a QGroundControl plan, MAVLink waypoints, or a vector file: " + readable_vector_formats(),
                 .found = QuietGdal::last_error(),
                 .fix = "check the file with `ogrinfo`"});
  }
  MissionDrawing drawing;
  DrawingReader reader(where, latitude_first, drawing);
  reader.read(*dataset);
  reader.finish();
  return drawing;
}

// A file of GDAL's in memory, under a name that no other thread has.
class VsiMemoryFile {
 public:
  VsiMemoryFile(std::string_view bytes, const char* ending) {
    static std::atomic<int> next{0};
    name_ = fmt::format("/vsimem/nadir_drawing_{}{}", next++, ending);
    VSIFCloseL(VSIFileFromMemBuffer(name_.c_str(), reinterpret_cast<GByte*>(const_cast<char*>(bytes.data())),
                                    bytes.size(), FALSE));
  }
  ~VsiMemoryFile() { VSIUnlink(name_.c_str()); }
  VsiMemoryFile(const VsiMemoryFile&) = delete;
  VsiMemoryFile& operator=(const VsiMemoryFile&) = delete;
  const std::string& name() const { return name_; }

 private:
  std::string name_;
};

void refuse_hostile_xml(std::string_view text, const std::string& where) {
  for (const std::string_view mark : {"<!DOCTYPE", "<!ENTITY", "<!doctype", "<!entity"}) {
    if (text.find(mark) == std::string_view::npos) continue;
    throw UsageError({.what = "the file declares a document type or entities",
                      .where = where,
                      .expected = "plain KML",
                      .found = std::string(mark),
                      .fix = "export the drawing again"});
  }
  if (text.find('\0') != std::string_view::npos) {
    throw UsageError({.what = "the file is not UTF-8 text",
                      .where = where,
                      .expected = "KML in UTF-8",
                      .found = "bytes of another encoding",
                      .fix = "save it as UTF-8"});
  }
}

}  // namespace

MissionDrawing read_kml_drawing(std::string_view text, const std::string& where, bool latitude_first) {
  register_gdal_drivers();
  refuse_hostile_xml(text, where);
  const VsiMemoryFile file(text, ".kml");
  return read_with_gdal(file.name(), where, latitude_first);
}

std::string kml_of_archive(const std::filesystem::path& path) {
  register_gdal_drivers();
  const QuietGdal quiet;
  const std::string archive = "/vsizip/{" + path.string() + "}";
  const auto refuse = [&](std::string expected, std::string found) {
    throw UsageError({.what = "the KMZ archive cannot be read",
                      .where = path.string(),
                      .expected = std::move(expected),
                      .found = std::move(found),
                      .fix = "export the drawing again, as KML"});
  };
  const std::unique_ptr<char*, decltype(&CSLDestroy)> names(VSIReadDirEx(archive.c_str(), kMaxArchiveEntries + 1),
                                                            &CSLDestroy);
  std::string document;
  const int entries = CSLCount(names.get());
  if (entries > kMaxArchiveEntries) refuse(fmt::format("at most {} files", kMaxArchiveEntries), "more");
  for (int i = 0; i < entries; ++i) {
    const std::string name = names.get()[i];
    if (!name.ends_with(".kml") && !name.ends_with(".KML")) continue;
    if (document.empty() || name == "doc.kml") document = name;
  }
  if (document.empty()) refuse("a KML document in it", entries == 0 ? "no files, or a damaged archive" : "none");
  VSILFILE* file = VSIFOpenL((archive + "/" + document).c_str(), "rb");
  if (file == nullptr) refuse("a KML document in it", document + ", which cannot be opened");
  std::string text;
  std::array<char, 65536> block{};
  while (text.size() <= kMaxDrawing_bytes) {
    const std::size_t got = VSIFReadL(block.data(), 1, block.size(), file);
    if (got == 0) break;
    text.append(block.data(), got);
  }
  VSIFCloseL(file);
  if (text.size() > kMaxDrawing_bytes) {
    refuse(fmt::format("a document of at most {} MB", kMaxDrawing_bytes >> 20), "one that decompresses to more");
  }
  return text;
}

MissionDrawing read_gis_drawing(const std::filesystem::path& path, bool latitude_first) {
  register_gdal_drivers();
  return read_with_gdal(path.string(), path.string(), latitude_first);
}

}  // namespace nadir
