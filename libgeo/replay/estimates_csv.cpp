#include "replay/estimates_csv.hpp"

#include <fmt/format.h>

#include "base/error.hpp"

namespace nadir {

EstimatesCsv::EstimatesCsv(const std::filesystem::path& path) : path_(path), file_(path, std::ios::binary) {
  file_ << header() << '\n' << std::flush;
  check();
}

void EstimatesCsv::write(const Estimate& estimate) {
  file_ << row(estimate) << '\n' << std::flush;
  check();
}

void EstimatesCsv::check() {
  if (file_) return;
  throw Error({.what = "the estimates cannot be written",
               .where = path_.string(),
               .fix = "see whether the disk is full and the folder may be written"});
}

std::string EstimatesCsv::header() {
  return "frame,time_s,lat_deg,lon_deg,sigma_m,source,segment,anchor_age_s,anchor_inliers,anchor_ratio,latency_ms";
}

std::string EstimatesCsv::row(const Estimate& e) {
  const std::string place =
      e.position ? fmt::format("{:.8f},{:.8f},{:.3f}", e.position->lat_deg, e.position->lon_deg, e.sigma_m) : ",,";
  const std::string anchor =
      e.anchor_age_s ? fmt::format("{:.3f},{},{:.4f}", *e.anchor_age_s, e.anchor_inliers, e.anchor_ratio) : ",,";
  const bool quoted = e.frame.find_first_of(",\"\n\r") != std::string::npos;
  std::string name = e.frame;
  if (quoted) {
    name = "\"";
    for (const char c : e.frame) name += c == '"' ? std::string("\"\"") : std::string(1, c);
    name += '"';
  }
  return fmt::format("{},{:.3f},{},{},{},{},{:.1f}", name, e.time_s, place, name_of(e.source), e.segment, anchor,
                     e.latency_ms);
}

}  // namespace nadir
