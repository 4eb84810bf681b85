// The track of a replay as files: estimates.csv and refined.csv (one row per frame, on disk as soon as it is computed)
// and track.geojson (RFC 7946: the track and the truth as lines, every estimate as a point with its figures).
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "estimation/estimate.hpp"
#include "replay/score.hpp"

namespace nadir {

class EstimatesCsv {
 public:
  explicit EstimatesCsv(const std::filesystem::path& path);  // writes the header; throws Error

  void write(const Estimate& estimate);  // flushed; throws Error when the disk is full

  static std::string header();
  static std::string row(const Estimate& estimate);  // without a line end; unknown cells stay empty

 private:
  void check();

  std::filesystem::path path_;
  std::ofstream file_;
};

std::string track_geojson(const std::vector<Estimate>& estimates, const std::vector<Estimate>& refined,
                          const Truth& truth);

}  // namespace nadir
