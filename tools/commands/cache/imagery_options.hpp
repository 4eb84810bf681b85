// The options that commands which make tiles from rasters have in common.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "base/time.hpp"
#include "package/manifest.hpp"
#include "package_build/vector_source.hpp"
#include "raster/imagery_input.hpp"
#include "raster/mosaic.hpp"

namespace nadir {

class Options;

class ImageryOptions {
 public:
  explicit ImageryOptions(std::string mosaic) : mosaic_(std::move(mosaic)) {}  // the default: priority, newest, finest

  void setup(Options& options);

  MosaicOptions mosaic() const;
  ImageryOverrides overrides() const { return {captured_, gsd_m_, ce90_m_, provider_, licence_, attribution_}; }
  int threads() const;  // all processors when not given

 private:
  std::string mosaic_;
  std::string seam_ = "hard";
  double feather_m_ = 10;
  std::optional<int> threads_;
  std::optional<UtcTime> captured_;
  std::optional<double> gsd_m_;
  std::optional<double> ce90_m_;
  std::optional<std::string> provider_, licence_, attribution_;
};

// The vectors of a package.
class VectorOptions {
 public:
  void setup(Options& options, std::string_view otherwise);  // what becomes of the package without them
  std::optional<VectorRequest> request() const;

 private:
  std::optional<std::filesystem::path> file_;
  std::optional<std::string> attribution_, licence_;
};

// "survey: CC-BY-4.0, © survey 2024"
std::string text_of(const SourceLicence& source);
nlohmann::json json_of(const std::vector<SourceLicence>& sources);

// "12 roads, 3 water, 4 woods, 56 buildings; © OpenStreetMap contributors, ODbL-1.0"
std::string text_of(const VectorFacts& vectors);
nlohmann::json json_of(const VectorFacts& vectors);

}  // namespace nadir
