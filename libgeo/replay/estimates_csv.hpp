// estimates.csv and refined.csv: one row per frame, on disk as soon as it is made.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>

#include "estimation/estimate.hpp"

namespace nadir {

class EstimatesCsv {
 public:
  explicit EstimatesCsv(const std::filesystem::path& path);  // writes the header; throws Error

  void write(const Estimate& estimate);  // flushed; throws Error when the disk is full

  static std::string header();
  static std::string row(const Estimate& estimate);  // without a line end; cells of what is unknown stay empty

 private:
  void check();

  std::filesystem::path path_;
  std::ofstream file_;
};

}  // namespace nadir
