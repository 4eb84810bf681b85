// The options that commands which make tiles from rasters have in common.
#pragma once

#include <optional>
#include <string>

#include "base/time.hpp"
#include "raster/imagery_input.hpp"
#include "raster/mosaic.hpp"

namespace nadir {

class Options;

class ImageryOptions {
 public:
  explicit ImageryOptions(std::string mosaic) : mosaic_(std::move(mosaic)) {}  // the default: priority, newest, finest

  void setup(Options& options);

  MosaicOptions mosaic() const;
  ImageryOverrides overrides() const { return {captured_, gsd_m_, ce90_m_, provider_}; }
  int threads() const;  // all processors when not given

 private:
  std::string mosaic_;
  std::string seam_ = "hard";
  double feather_m_ = 10;
  std::optional<int> threads_;
  std::optional<UtcTime> captured_;
  std::optional<double> gsd_m_;
  std::optional<double> ce90_m_;
  std::optional<std::string> provider_;
};

}  // namespace nadir
