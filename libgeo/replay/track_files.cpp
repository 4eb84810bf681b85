#include "replay/track_files.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/csv.hpp"
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
               .fix = "check whether the disk is full and the folder is writable"});
}

std::string EstimatesCsv::header() {
  return "frame,time_s,lat_deg,lon_deg,sigma_m,source,segment,anchor_age_s,anchor_inliers,anchor_ratio,latency_ms,"
         "hpl_m";
}

std::string EstimatesCsv::row(const Estimate& e) {
  const std::string place =
      e.position ? fmt::format("{:.8f},{:.8f},{:.3f}", e.position->lat_deg, e.position->lon_deg, e.sigma_m) : ",,";
  const std::string anchor =
      e.anchor_age_s ? fmt::format("{:.3f},{},{:.4f}", *e.anchor_age_s, e.anchor_inliers, e.anchor_ratio) : ",,";
  const std::string hpl = e.position && e.hpl_m ? fmt::format("{:.3f}", *e.hpl_m) : "";
  return fmt::format("{},{:.3f},{},{},{},{},{:.1f},{}", csv_cell(e.frame), e.time_s, place, name_of(e.source),
                     e.segment, anchor, e.latency_ms, hpl);
}

namespace {

using nlohmann::json;

// RFC 7946 asks for no more digits than mean something: 1e-8 degrees are a millimetre.
json position(LonLat place) {
  return json::array({std::round(place.lon_deg * 1e8) / 1e8, std::round(place.lat_deg * 1e8) / 1e8});
}

json feature(const char* kind, json geometry, json properties) {
  properties["kind"] = kind;
  return {{"type", "Feature"}, {"geometry", std::move(geometry)}, {"properties", std::move(properties)}};
}

// A line needs two positions; fewer are no line.
void add_line(json& features, const char* kind, const json& positions) {
  if (positions.size() < 2) return;
  features.push_back(feature(kind, {{"type", "LineString"}, {"coordinates", positions}}, json::object()));
}

json positions_of(const std::vector<Estimate>& estimates) {
  json positions = json::array();
  for (const Estimate& estimate : estimates) {
    if (estimate.position) positions.push_back(position(*estimate.position));
  }
  return positions;
}

}  // namespace

std::string track_geojson(const std::vector<Estimate>& estimates, const std::vector<Estimate>& refined,
                          const Truth& truth) {
  json features = json::array();
  add_line(features, "track", positions_of(estimates));
  add_line(features, "refined", positions_of(refined));
  json real = json::array();
  for (const auto& place : truth) {
    if (place) real.push_back(position(*place));
  }
  add_line(features, "truth", real);
  for (const Estimate& estimate : estimates) {
    if (!estimate.position) continue;
    features.push_back(feature("estimate", {{"type", "Point"}, {"coordinates", position(*estimate.position)}},
                               {{"frame", estimate.frame},
                                {"time_s", estimate.time_s},
                                {"sigma_m", std::round(estimate.sigma_m * 1000) / 1000},
                                {"source", name_of(estimate.source)},
                                {"segment", estimate.segment}}));
  }
  const json document = {{"type", "FeatureCollection"}, {"features", std::move(features)}};
  return document.dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace nadir
