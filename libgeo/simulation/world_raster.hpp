// The world that a simulated flight sees: any georeferenced image, kept as a pyramid, and the shape of its ground.
//
// All positions are in the flight's local frame (east-north-up metres, geodetic heights in the vertical datum of the
// elevation model) and transformed through PROJ, so that truth and pixels agree.
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

namespace nadir {

// Height of the ground over the local frame's plane; flat at 0 without an elevation model.
class GroundShape {
 public:
  GroundShape() = default;  // flat: everywhere at the height of the frame's origin
  // Resamples the model's heights to a grid in the frame. Throws UsageError when it does not meet `box`.
  GroundShape(const std::filesystem::path& dem, const LocalFrame& frame, const PlaneBox& box);

  double up_m(PlanePoint point) const;
  // False beyond the model, where up_m() continues with the heights of its edge.
  bool covers(PlanePoint point) const;
  // The mean geodetic height of the model around a position, to choose a frame's origin.
  static double height_at(const std::filesystem::path& dem, LonLat place);

 private:
  cv::Mat_<float> up_;
  cv::Mat_<std::uint8_t> covered_;
  double west_m_ = 0, south_m_ = 0, step_m_ = 1;
};

class WorldRaster {
 public:
  // Reads what lies within `box` of the frame, no finer than needed for images of needed_gsd_m. Throws Error or
  // UsageError when the file is missing, truncated, not georeferenced or not 8 bit.
  WorldRaster(const std::filesystem::path& path, const LocalFrame& frame, const PlaneBox& box, double needed_gsd_m);
  ~WorldRaster();

  // True when the position lies on valid pixels of the raster.
  bool covers(PlanePoint position) const;

  // Raster coordinates (continuous, pixel centres at +0.5) of points given in the frame.
  void raster_from_enu(std::span<Eigen::Vector3d> points) const;

  // level 0 is the finest; each further one has pixels twice as large.
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

// Position and size of a raster, before its pixels are read.
struct WorldExtent {
  LonLat centre;
  cv::Size size;     // pixels
  double gsd_m = 0;  // of its pixels at the centre: the geometric mean of both directions
  PlaneBox box;      // around all of it, in metres from the centre
};

// Throws Error or UsageError when the file is missing, no raster, or not georeferenced.
WorldExtent extent_of_world(const std::filesystem::path& path);

}  // namespace nadir
