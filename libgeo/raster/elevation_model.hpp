// Heights of the ground at single places, from any elevation model that GDAL reads.
//
// Heights keep the vertical datum of the file, in metres; only their differences are the same in every datum.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "geodesy/lon_lat.hpp"

namespace nadir {

class ElevationModel {
 public:
  // Throws Error when the file cannot be read, UsageError when it is no georeferenced raster of one band of metres.
  explicit ElevationModel(const std::filesystem::path& path);
  ~ElevationModel();
  ElevationModel(const ElevationModel&) = delete;
  ElevationModel& operator=(const ElevationModel&) = delete;

  // Bilinear between the four posts around the place; nothing outside, or where one of them is unknown.
  std::optional<double> height_m(LonLat place) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
