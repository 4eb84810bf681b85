// The world that a simulated flight sees: any georeferenced picture, kept as a pyramid, and the shape of its ground.
//
// Everything is asked for in the flight's local frame (east-north-up metres, geodetic heights as the elevation model
// gives them) and answered through PROJ, so that truth and pixels agree.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <span>
#include <vector>

#include "geodesy/local_frame.hpp"
#include "geodesy/lon_lat.hpp"
#include "geodesy/region.hpp"

class GDALDataset;
class OGRCoordinateTransformation;

namespace nadir {

// Height of the ground over the local frame's plane; flat at 0 without an elevation model.
class GroundShape {
 public:
  GroundShape() = default;  // flat: everywhere at the height of the frame's origin
  // Resamples the model's heights to a grid in the frame. Throws UsageError when it does not meet `box`.
  GroundShape(const std::filesystem::path& dem, const LocalFrame& frame, const PlaneBox& box);

  double up_m(double east_m, double north_m) const;
  // False beyond the model, where up_m() goes on with the rim's heights.
  bool covers(double east_m, double north_m) const;
  // The mean geodetic height of the model within a few cells of a place, to choose a frame's origin.
  static double height_at(const std::filesystem::path& dem, LonLat place);

 private:
  cv::Mat_<float> up_;
  cv::Mat_<std::uint8_t> covered_;
  double west_m_ = 0, south_m_ = 0, step_m_ = 1;
};

class WorldRaster {
 public:
  // Reads what lies within `box` of the frame, no finer than needed for pictures of needed_gsd_m. Throws Error or
  // UsageError for what is missing, truncated, without georeference or not 8 bit.
  WorldRaster(const std::filesystem::path& path, const LocalFrame& frame, const PlaneBox& box, double needed_gsd_m);
  ~WorldRaster();

  // True when the place lies on the raster and has pixels there.
  bool covers(double east_m, double north_m) const;

  // Raster coordinates (continuous, pixel centres at +0.5) of points given in the frame.
  void raster_from_enu(std::span<Eigen::Vector3d> points) const;

  // level 0 is the finest; each further one has pixels twice as large. BGR with validity in a mask.
  struct Level {
    cv::Mat image;      // CV_8UC3
    cv::Mat mask;       // CV_8UC1
    bool whole = true;  // every pixel is valid
  };
  const std::vector<Level>& levels() const { return levels_; }

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::vector<Level> levels_;
};

// Between a raster's pixels and longitudes and latitudes, through GDAL's geotransform and PROJ.

class Georeference {
 public:
  // Throws UsageError when the raster has no coordinate system or geotransform, or PROJ does not know it.
  Georeference(GDALDataset& dataset, const std::filesystem::path& path);
  ~Georeference();
  Georeference(Georeference&&) noexcept;
  Georeference& operator=(Georeference&&) noexcept;

  // Longitudes and latitudes in, continuous pixels out. False when some cannot be reached; those are not finite.
  bool pixels_from_lonlat(std::vector<double>& x, std::vector<double>& y) const;
  // Throws UsageError for pixels that lie nowhere on Earth.
  LonLat lonlat_from_pixel(double column, double row) const;

 private:
  std::filesystem::path path_;
  std::unique_ptr<OGRCoordinateTransformation> crs_from_lonlat_, lonlat_from_crs_;
  double forward_[6] = {};   // crs from pixel
  double backward_[6] = {};  // pixel from crs
};

// Where a raster lies and how large it is, before anything of it is read.

struct WorldExtent {
  LonLat centre;
  cv::Size size;     // pixels
  double gsd_m = 0;  // of its pixels at the centre: the geometric mean of both directions
  PlaneBox box;      // around all of it, in metres from the centre
};

// Throws Error or UsageError for what is missing, no raster, or without georeference.
WorldExtent extent_of_world(const std::filesystem::path& path);

}  // namespace nadir
