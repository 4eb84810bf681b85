#include "commands/recorder/export/export_gdal.hpp"

#include <ogrsf_frmts.h>

#include <cmath>
#include <memory>

#include "base/error.hpp"

namespace nadir {
namespace {

OGRFieldType field_type(CellType type) {
  switch (type) {
    case CellType::integer: return OFTInteger64;
    case CellType::real: return OFTReal;
    case CellType::text: return OFTString;
  }
  return OFTString;
}

class Exporter {
 public:
  Exporter(const std::string& driver_name, const std::filesystem::path& path) : path_(path) {
    GDALAllRegister();
    GDALDriver* driver = GetGDALDriverManager()->GetDriverByName(driver_name.c_str());
    if (driver == nullptr) {
      throw Error(
          {.what = "this GDAL cannot write " + driver_name,
           .where = path,
           .expected = "a GDAL with the driver " + driver_name + " (Parquet: built with Apache Arrow, or its plug-in)",
           .found = std::string("GDAL ") + GDALVersionInfo("RELEASE_NAME") + " without it, as Debian 12 has it",
           .fix = "export --format csv, or gpkg, and convert where there is such a GDAL"});
    }
    one_layer_ = driver_name == "Parquet";
    dataset_.reset(driver->Create(path.c_str(), 0, 0, 0, GDT_Unknown, nullptr));
    if (!dataset_) fail();
    wgs84_.SetWellKnownGeogCS("WGS84");
    wgs84_.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  }

  void table(const Table& table) {
    OGRLayer* layer = make_layer(table.name, table.places ? wkbPoint : wkbNone);
    for (const Column& column : table.columns) {
      OGRFieldDefn field(column.name.c_str(), field_type(column.type));
      if (layer->CreateField(&field) != OGRERR_NONE) fail();
    }
    for (const TableRow& row : table.rows) {
      OGRFeature feature(layer->GetLayerDefn());
      for (std::size_t i = 0; i < row.cells.size(); ++i) set(feature, table.columns[i].name, row.cells[i]);
      if (row.place) {
        OGRPoint point(row.place->lon_deg, row.place->lat_deg);
        feature.SetGeometry(&point);
      }
      if (layer->CreateFeature(&feature) != OGRERR_NONE) fail();
    }
  }

  void track(const Table& estimates) {
    OGRLineString line;
    for (const TableRow& row : estimates.rows) {
      if (row.place) line.addPoint(row.place->lon_deg, row.place->lat_deg);
    }
    if (line.getNumPoints() < 2) return;
    OGRLayer* layer = make_layer("track", wkbLineString);
    OGRFeature feature(layer->GetLayerDefn());
    feature.SetGeometry(&line);
    if (layer->CreateFeature(&feature) != OGRERR_NONE) fail();
  }

  bool one_layer() const { return one_layer_; }

  void close() {
    CPLErrorReset();
    dataset_.reset();
    if (CPLGetLastErrorType() >= CE_Failure) fail();
  }

 private:
  struct Close {
    void operator()(GDALDataset* dataset) const { GDALClose(dataset); }
  };

  OGRLayer* make_layer(const std::string& name, OGRwkbGeometryType type) {
    OGRLayer* layer = dataset_->CreateLayer(name.c_str(), type == wkbNone ? nullptr : &wgs84_, type, nullptr);
    if (layer == nullptr) fail();
    return layer;
  }

  static void set(OGRFeature& feature, const std::string& name, const Cell& cell) {
    const int field = feature.GetFieldIndex(name.c_str());
    if (field < 0) return;
    if (const auto* text = std::get_if<std::string>(&cell)) feature.SetField(field, text->c_str());
    if (const auto* number = std::get_if<double>(&cell); number != nullptr && std::isfinite(*number)) {
      feature.SetField(field, *number);
    }
    if (const auto* number = std::get_if<std::int64_t>(&cell)) feature.SetField(field, static_cast<GIntBig>(*number));
  }

  [[noreturn]] void fail() const {
    throw Error({.what = "the recording cannot be exported", .where = path_, .found = CPLGetLastErrorMsg()});
  }

  std::filesystem::path path_;
  OGRSpatialReference wgs84_;
  std::unique_ptr<GDALDataset, Close> dataset_;
  bool one_layer_ = false;
};

}  // namespace

void export_gdal(const FlightTables& tables, const std::string& driver, const std::filesystem::path& path) {
  Exporter exporter(driver, path);
  exporter.table(tables.estimates);
  if (!exporter.one_layer()) {
    exporter.table(tables.anchors);
    if (driver != "KML") exporter.table(tables.events);
    exporter.track(tables.estimates);
  }
  exporter.close();
}

}  // namespace nadir
