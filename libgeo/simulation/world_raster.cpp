#include "simulation/world_raster.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace {

// Between a raster's pixels and longitudes and latitudes, through GDAL's geotransform and PROJ.

class Georeference {
 public:
  // Throws UsageError when the raster has no coordinate system or geotransform, or PROJ does not support it.
  Georeference(GDALDataset& dataset, const std::filesystem::path& path);
  // Longitudes and latitudes in, continuous pixels out. False when some cannot be transformed; those are not finite.
  bool pixels_from_lonlat(std::vector<double>& x, std::vector<double>& y) const;
  // Throws UsageError for pixels without a position on Earth.
  LonLat lonlat_from_pixel(double column, double row) const;

 private:
  std::filesystem::path path_;
  std::unique_ptr<OGRCoordinateTransformation> crs_from_lonlat_, lonlat_from_crs_;
  double forward_[6] = {};   // crs from pixel
  double backward_[6] = {};  // pixel from crs
};

Georeference::Georeference(GDALDataset& dataset, const std::filesystem::path& path) : path_(path) {
  const OGRSpatialReference* crs = dataset.GetSpatialRef();
  if (crs == nullptr || dataset.GetGeoTransform(forward_) != CE_None || !GDALInvGeoTransform(forward_, backward_)) {
    throw UsageError({.what = "the raster is not georeferenced",
                      .where = path.string(),
                      .expected = "a coordinate system and a geotransform",
                      .found = crs == nullptr ? "no coordinate system" : "no geotransform",
                      .fix = "use a GeoTIFF; gdal_translate -a_srs EPSG:… -a_ullr … adds what is missing"});
  }
  OGRSpatialReference wgs84;
  wgs84.SetFromUserInput("EPSG:4326");
  wgs84.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  OGRSpatialReference own(*crs);
  own.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  crs_from_lonlat_.reset(OGRCreateCoordinateTransformation(&wgs84, &own));
  lonlat_from_crs_.reset(OGRCreateCoordinateTransformation(&own, &wgs84));
  if (!crs_from_lonlat_ || !lonlat_from_crs_) {
    throw UsageError({.what = "PROJ does not support the raster's coordinate system",
                      .where = path.string(),
                      .fix = "reproject it: gdalwarp -t_srs EPSG:…"});
  }
}

bool Georeference::pixels_from_lonlat(std::vector<double>& x, std::vector<double>& y) const {
  std::vector<int> ok(x.size(), 1);
  crs_from_lonlat_->Transform(static_cast<int>(x.size()), x.data(), y.data(), nullptr, ok.data());
  bool all = true;
  for (std::size_t i = 0; i < x.size(); ++i) {
    all = all && ok[i] != 0;
    const double cx = x[i], cy = y[i];
    x[i] = backward_[0] + cx * backward_[1] + cy * backward_[2];
    y[i] = backward_[3] + cx * backward_[4] + cy * backward_[5];
  }
  return all;
}

LonLat Georeference::lonlat_from_pixel(double column, double row) const {
  double x = forward_[0] + column * forward_[1] + row * forward_[2];
  double y = forward_[3] + column * forward_[4] + row * forward_[5];
  if (lonlat_from_crs_->Transform(1, &x, &y) == 0 || !std::isfinite(x) || !std::isfinite(y)) {
    throw UsageError({.what = "the raster has no position on Earth",
                      .where = path_.string(),
                      .expected = "pixels within the domain of its coordinate system",
                      .found = fmt::format("none at column {}, row {}", column, row),
                      .fix = "check its georeference with gdalinfo"});
  }
  return {x, y};
}

}  // namespace

WorldExtent extent_of_world(const std::filesystem::path& path) {
  const GdalDataset dataset(path);
  const Georeference geo(*dataset.handle(), path);
  WorldExtent extent;
  extent.size = dataset.size();
  const double width = extent.size.width, height = extent.size.height;
  extent.centre = geo.lonlat_from_pixel(width / 2, height / 2);
  const LocalFrame frame(extent.centre);
  const auto at = [&](double column, double row) {
    return frame.plane_from_lonlat(geo.lonlat_from_pixel(column, row));
  };
  const PlanePoint right = at(width / 2 + 1, height / 2), down = at(width / 2, height / 2 + 1);
  extent.gsd_m = std::sqrt(std::abs(right.east_m * down.north_m - right.north_m * down.east_m));
  extent.box = {1e12, 1e12, -1e12, -1e12};
  constexpr int kSteps = 16;  // along each edge: a projection's edges are curved
  for (int i = 0; i <= kSteps; ++i) {
    const double t = static_cast<double>(i) / kSteps;
    for (const PlanePoint p : {at(t * width, 0), at(t * width, height), at(0, t * height), at(width, t * height)}) {
      extent.box.west_m = std::min(extent.box.west_m, p.east_m);
      extent.box.east_m = std::max(extent.box.east_m, p.east_m);
      extent.box.south_m = std::min(extent.box.south_m, p.north_m);
      extent.box.north_m = std::max(extent.box.north_m, p.north_m);
    }
  }
  return extent;
}

namespace {

// The raster window around a box of the plane, clipped to the raster; empty when they do not overlap.
cv::Rect window_of(const Georeference& geo, cv::Size size, const LocalFrame& frame, const PlaneBox& box,
                   double rim_px) {
  std::vector<double> x, y;
  for (int i = 0; i <= 16; ++i) {
    for (int j = 0; j <= 16; ++j) {
      const LonLat p = frame.lonlat_from_plane(
          {std::lerp(box.west_m, box.east_m, i / 16.0), std::lerp(box.south_m, box.north_m, j / 16.0)});
      x.push_back(p.lon_deg), y.push_back(p.lat_deg);
    }
  }
  if (!geo.pixels_from_lonlat(x, y)) return {};
  const auto [x0, x1] = std::minmax_element(x.begin(), x.end());
  const auto [y0, y1] = std::minmax_element(y.begin(), y.end());
  const auto low = [&](double v, int limit) {
    return static_cast<int>(std::clamp<double>(std::floor(v - rim_px), 0, limit));
  };
  const auto high = [&](double v, int limit) {
    return static_cast<int>(std::clamp<double>(std::ceil(v + rim_px), 0, limit));
  };
  const int left = low(*x0, size.width), right = high(*x1, size.width);
  const int top = low(*y0, size.height), bottom = high(*y1, size.height);
  return {left, top, right - left, bottom - top};
}

GdalHandle open_heights(const std::filesystem::path& path) {
  register_gdal_drivers();
  const QuietGdal quiet;
  refuse_remote_raster(path);
  GdalHandle dataset(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR));
  if (!dataset || dataset->GetRasterCount() < 1) {
    throw Error({.what = "the elevation model cannot be opened",
                 .where = path.string(),
                 .expected = "a raster of heights that GDAL reads",
                 .found = QuietGdal::last_error(),
                 .fix = "check the file with `gdalinfo`, or omit --dem to fly over flat ground"});
  }
  return dataset;
}

[[noreturn]] void not_covered(const std::filesystem::path& path) {
  throw UsageError({.what = "the elevation model does not cover the flight",
                    .where = path.string(),
                    .expected = "heights everywhere that the camera sees along the route",
                    .fix = "use a larger model, or omit --dem to fly over flat ground"});
}

double sample(const cv::Mat_<float>& grid, double column, double row) {
  const double c = std::clamp(column, 0.0, grid.cols - 1.0), r = std::clamp(row, 0.0, grid.rows - 1.0);
  const int c0 = std::min(static_cast<int>(c), std::max(0, grid.cols - 2)),
            r0 = std::min(static_cast<int>(r), std::max(0, grid.rows - 2));
  const int c1 = std::min(c0 + 1, grid.cols - 1), r1 = std::min(r0 + 1, grid.rows - 1);
  const double tc = c - c0, tr = r - r0;
  const auto at = [&](int rr, int cc) { return static_cast<double>(grid(rr, cc)); };
  return std::lerp(std::lerp(at(r0, c0), at(r0, c1), tc), std::lerp(at(r1, c0), at(r1, c1), tc), tr);
}

struct Heights {
  cv::Mat_<float> values;
  cv::Rect window;
  Georeference geo;
};

Heights read_heights(const std::filesystem::path& path, const LocalFrame& frame, const PlaneBox& box) {
  const GdalHandle dataset = open_heights(path);
  const QuietGdal quiet;
  Heights heights{.values = {}, .window = {}, .geo = Georeference(*dataset, path)};
  heights.window = window_of(heights.geo, {dataset->GetRasterXSize(), dataset->GetRasterYSize()}, frame, box, 3);
  const cv::Rect& w = heights.window;
  if (w.width < 1 || w.height < 1) not_covered(path);
  if (static_cast<double>(w.width) * w.height > 2e8) {
    throw UsageError({.what = "the elevation model is too fine for this flight",
                      .where = path.string(),
                      .found = fmt::format("{} x {} heights", w.width, w.height),
                      .fix = "resample it to 5 m or coarser"});
  }
  heights.values.create(w.height, w.width);
  GDALRasterBand* band = dataset->GetRasterBand(1);
  if (band->RasterIO(GF_Read, w.x, w.y, w.width, w.height, heights.values.data, w.width, w.height, GDT_Float32, 4,
                     static_cast<GSpacing>(heights.values.step), nullptr) != CE_None) {
    throw Error({.what = "the elevation model cannot be read",
                 .where = path.string(),
                 .expected = "a complete file",
                 .found = QuietGdal::last_error(),
                 .fix = "download the file again"});
  }
  int has_nodata = 0;
  const auto nodata = static_cast<float>(band->GetNoDataValue(&has_nodata));
  for (const float value : heights.values) {
    if (!std::isfinite(value) || (has_nodata != 0 && std::abs(value - nodata) < 1e-3F)) not_covered(path);
  }
  return heights;
}

}  // namespace

GroundShape::GroundShape(const std::filesystem::path& dem, const LocalFrame& frame, const PlaneBox& box) {
  const Heights heights = read_heights(dem, frame, box);
  // The model's own spacing, measured across the middle.
  const double width = box.east_m - box.west_m, height = box.north_m - box.south_m;
  step_m_ = std::clamp(std::min(width / heights.window.width, height / heights.window.height), 1.0, 60.0);
  west_m_ = box.west_m, south_m_ = box.south_m;
  up_.create(static_cast<int>(height / step_m_) + 2, static_cast<int>(width / step_m_) + 2);
  covered_.create(up_.size());
  std::vector<double> x(static_cast<std::size_t>(up_.cols)), y(x.size());
  std::vector<LonLat> places(x.size());
  for (int row = 0; row < up_.rows; ++row) {
    for (int column = 0; column < up_.cols; ++column) {
      const auto i = static_cast<std::size_t>(column);
      places[i] = frame.lonlat_from_plane({west_m_ + column * step_m_, south_m_ + row * step_m_});
      x[i] = places[i].lon_deg, y[i] = places[i].lat_deg;
    }
    if (!heights.geo.pixels_from_lonlat(x, y)) not_covered(dem);
    for (int column = 0; column < up_.cols; ++column) {
      const auto i = static_cast<std::size_t>(column);
      const double c = x[i] - 0.5 - heights.window.x, r = y[i] - 0.5 - heights.window.y;
      // The outer cells reach half a cell beyond their centres.
      covered_(row, column) =
          c >= -0.5 && r >= -0.5 && c <= heights.values.cols - 0.5 && r <= heights.values.rows - 0.5;
      const double h = sample(heights.values, c, r);
      up_(row, column) = static_cast<float>(frame.enu_from_geodetic({places[i], h}).up_m);
    }
  }
}

double GroundShape::up_m(PlanePoint point) const {
  // Level ground follows the Earth: it falls below the frame's plane, by 8 cm at one kilometre.
  if (up_.empty()) return -(point.east_m * point.east_m + point.north_m * point.north_m) / (2 * 6371000.0);
  return sample(up_, (point.east_m - west_m_) / step_m_, (point.north_m - south_m_) / step_m_);
}

bool GroundShape::covers(PlanePoint point) const {
  if (up_.empty()) return true;
  const auto column = std::lround((point.east_m - west_m_) / step_m_);
  const auto row = std::lround((point.north_m - south_m_) / step_m_);
  if (column < 0 || row < 0 || column >= up_.cols || row >= up_.rows) return false;
  return covered_(static_cast<int>(row), static_cast<int>(column)) != 0;
}

double GroundShape::height_at(const std::filesystem::path& dem, LonLat place) {
  const LocalFrame frame(place);
  const Heights heights = read_heights(dem, frame, {-1, -1, 1, 1});
  std::vector<double> x = {place.lon_deg}, y = {place.lat_deg};
  if (!heights.geo.pixels_from_lonlat(x, y)) not_covered(dem);
  return sample(heights.values, x[0] - 0.5 - heights.window.x, y[0] - 0.5 - heights.window.y);
}

struct WorldRaster::Impl {
  LocalFrame frame;
  Georeference geo;
  cv::Rect window;
  double shrink_x = 1, shrink_y = 1;
};

WorldRaster::~WorldRaster() = default;

WorldRaster::WorldRaster(const std::filesystem::path& path, const LocalFrame& frame, const PlaneBox& box,
                         double needed_gsd_m) {
  const GdalDataset dataset(path);
  impl_ = std::make_unique<Impl>(Impl{frame, Georeference(*dataset.handle(), path), {}, 1, 1});
  impl_->window = window_of(impl_->geo, dataset.size(), frame, box, 4);
  const cv::Rect& w = impl_->window;
  if (w.width < 2 || w.height < 2) {
    throw UsageError({.what = "the route lies outside the world",
                      .where = path.string(),
                      .expected = "a raster that covers the mission's route",
                      .fix = "use the raster and the mission that belong together"});
  }
  // The resolution of the raster: its pixels per one hundred metres at the origin.
  std::vector<Eigen::Vector3d> probe = {{0, 0, 0}, {100, 0, 0}};
  raster_from_enu(probe);
  const double gsd = 100 / std::max(1e-9, (probe[1] - probe[0]).norm());
  int shrink = 1;
  while (gsd * shrink * 2 <= needed_gsd_m && shrink < 64) shrink *= 2;
  const cv::Size size(std::max(1, w.width / shrink), std::max(1, w.height / shrink));
  if (static_cast<double>(size.width) * size.height > 6e8) {
    throw UsageError({.what = "the flight needs too large a part of this raster",
                      .where = path.string(),
                      .expected = "at most 600 million pixels",
                      .found = fmt::format("{} x {}", size.width, size.height),
                      .fix = "fly a shorter route or use a coarser raster"});
  }
  impl_->shrink_x = static_cast<double>(w.width) / size.width;
  impl_->shrink_y = static_cast<double>(w.height) / size.height;
  MaskedImage image = dataset.read(w, size);
  const bool whole = cv::countNonZero(image.mask == 255) == image.mask.rows * image.mask.cols;
  levels_.push_back({image.bgr, image.mask, whole});
  while (levels_.size() < 8 && std::min(levels_.back().image.cols, levels_.back().image.rows) >= 64) {
    const Level& fine = levels_.back();
    // Even sizes keep (x + 0.5) / 2 − 0.5 exact from level to level.
    const cv::Rect even(0, 0, fine.image.cols & ~1, fine.image.rows & ~1);
    Level half{.image = {}, .mask = {}, .whole = fine.whole};
    cv::resize(fine.image(even), half.image, {even.width / 2, even.height / 2}, 0, 0, cv::INTER_AREA);
    cv::resize(fine.mask(even), half.mask, {even.width / 2, even.height / 2}, 0, 0, cv::INTER_AREA);
    levels_.push_back(std::move(half));
  }
}

void WorldRaster::raster_from_enu(std::span<Eigen::Vector3d> points) const {
  std::vector<double> x, y;
  x.reserve(points.size()), y.reserve(points.size());
  for (const Eigen::Vector3d& p : points) {
    const Geodetic g = impl_->frame.geodetic_from_enu({p.x(), p.y(), p.z()});
    x.push_back(g.place.lon_deg), y.push_back(g.place.lat_deg);
  }
  impl_->geo.pixels_from_lonlat(x, y);
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i] = {(x[i] - impl_->window.x) / impl_->shrink_x, (y[i] - impl_->window.y) / impl_->shrink_y, 0};
  }
}

bool WorldRaster::covers(PlanePoint position) const {
  std::vector<Eigen::Vector3d> point = {{position.east_m, position.north_m, 0}};
  raster_from_enu(point);
  const cv::Mat& mask = levels_.front().mask;
  const double x = point[0].x(), y = point[0].y();
  if (!(x >= 0 && y >= 0 && x < mask.cols && y < mask.rows)) return false;
  return mask.at<std::uint8_t>(static_cast<int>(y), static_cast<int>(x)) >= 128;
}

}  // namespace nadir
