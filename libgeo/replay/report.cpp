#include "replay/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "base/bytes.hpp"
#include "cli/nadir_version.hpp"
#include "imagery/codecs.hpp"
#include "imagery/map_window.hpp"
#include "map_page/map_page.hpp"
#include "replay/report_page.hpp"
#include "report/page_text.hpp"

namespace nadir {
namespace {

using nlohmann::json;

json anchor_json(const AnchorReport& anchor) {
  return {{"verdict", name_of(anchor.verdict)},
          {"ratio", rounded(anchor.ratio)},
          {"inliers", anchor.inliers},
          {"patches", anchor.patches},
          {"residual", rounded(anchor.residual_px)},
          {"window", rounded(anchor.window_radius_m)}};
}

json frame_json(const FrameReport& report, const std::optional<double>& error_m, const LocalFrame& frame) {
  const Estimate& e = report.estimate;
  json item = {{"name", e.frame},
               {"time", rounded(e.time_s)},
               {"source", name_of(e.source)},
               {"segment", e.segment},
               {"latency", rounded(e.latency_ms, 10)},
               {"age", e.anchor_age_s ? json(rounded(*e.anchor_age_s)) : json()},
               {"error", error_m ? json(rounded(*error_m)) : json()},
               {"covariance", {0, 0, 0}},
               {"sigma", e.position ? json(rounded(e.sigma_m)) : json()},
               {"hpl", e.position && e.hpl_m ? json(rounded(*e.hpl_m)) : json()},
               {"anchor", anchor_json(report.anchor)},
               {"odometry",
                {{"tracked", report.odometry.tracked},
                 {"inliers", report.odometry.inliers},
                 {"step", rounded(report.odometry.step_m)}}}};
  if (e.position) {
    const PlanePoint at = frame.plane_from_lonlat(*e.position);
    item["east"] = rounded(at.east_m);
    item["north"] = rounded(at.north_m);
    item["lat"] = e.position->lat_deg;
    item["lon"] = e.position->lon_deg;
    item["covariance"] = {rounded(e.covariance_m2(0, 0)), rounded(e.covariance_m2(0, 1)),
                          rounded(e.covariance_m2(1, 1))};
  }
  return item;
}

json place_json(const std::optional<LonLat>& place, const LocalFrame& frame) {
  if (!place) return {};
  const PlanePoint at = frame.plane_from_lonlat(*place);
  return json::array({rounded(at.east_m), rounded(at.north_m)});
}

json tile(std::string value, const char* unit, const char* label, const char* mood = "") {
  return {{"value", std::move(value)}, {"unit", unit}, {"label", label}, {"mood", mood}};
}

// The few numbers that answer "was it good?".
json tiles_json(const Score& score, bool nothing_localized) {
  json tiles = json::array();
  if (const auto& e = score.errors) {
    tiles.push_back(tile(fmt::format("{:.1f}", e->median_m), "m", "median error"));
    tiles.push_back(tile(fmt::format("{:.1f}", e->p95_m), "m", "95 % of errors below"));
  }
  if (score.localized_share > 0 || nothing_localized) {
    tiles.push_back(tile(fmt::format("{:.0f}", 100 * score.localized_share), "%", "of frames anchored to the map",
                         nothing_localized ? "bad" : ""));
  }
  if (const auto& e = score.errors) {
    if (score.localized_share > 0)
      tiles.push_back(tile(fmt::format("{}", e->wrong_anchors), "", "anchors wrong by > 50 m",
                           e->wrong_anchors == 0 ? "good" : "bad"));
    tiles.push_back(tile(fmt::format("{:.0f}", 100 * e->inside_95_share), "%", "of truth inside the 95 % ellipse"));
  }
  tiles.push_back(tile(fmt::format("{:.0f}", score.latency.p50_ms), "ms", "per frame, median"));
  return tiles;
}

json integrity_json(const IntegrityFigures& integrity) {
  const std::size_t misleading = integrity.misleading + integrity.unavailable_misleading;
  return {{"limit", integrity.alert_limit_m},
          {"counts",
           {{"available", integrity.available},
            {"unavailable", integrity.unavailable},
            {"misleading", misleading},
            {"hazardously misleading", integrity.hazardously_misleading}}}};
}

constexpr std::size_t kMaxShownVectors = 50'000;  // what a page still loads at once

// In the local plane, as the rest of the map; those that lie on it.
json vectors_json(const VectorLayer& vectors, const ReportMap& map, const LocalFrame& frame) {
  json features = json::array();
  for (const MapVector& vector : vectors.features) {
    if (features.size() == kMaxShownVectors) break;
    json parts = json::array();
    PlaneBox box{INFINITY, INFINITY, -INFINITY, -INFINITY};
    for (const std::vector<LonLat>& part : vector.parts) {
      json points = json::array();
      for (const LonLat& place : part) {
        const PlanePoint at = frame.plane_from_lonlat(place);
        points.push_back({rounded(at.east_m, 10), rounded(at.north_m, 10)});
        box = {std::min(box.west_m, at.east_m), std::min(box.south_m, at.north_m), std::max(box.east_m, at.east_m),
               std::max(box.north_m, at.north_m)};
      }
      parts.push_back(std::move(points));
    }
    const bool beside = box.east_m < map.west_m || box.west_m > map.west_m + map.width_m || box.south_m > map.north_m ||
                        box.north_m < map.north_m - map.height_m;
    if (beside) continue;
    features.push_back({{"properties", {{"class", name_of(vector.cls)}, {"kind", vector.kind}}},
                        {"geometry",
                         {{"type", vector.is_area ? "Polygon" : "LineString"},
                          {"coordinates", vector.is_area ? parts : parts.front()}}}});
  }
  return {{"attribution", vectors.attribution}, {"licence", vectors.licence}, {"features", std::move(features)}};
}

json page_data(const ReportInput& input) {
  std::vector<Estimate> estimates;
  for (const FrameReport& report : input.frames) estimates.push_back(report.estimate);
  const auto errors = errors_m(estimates, input.truth, input.frame);

  json data = {{"title", input.title},
               {"subtitle", input.subtitle},
               {"generator", fmt::format("Created by nadir {}", kVersion)},
               {"tiles", tiles_json(input.score, !input.notice.empty())},
               {"notice", input.notice},
               {"integrity", integrity_json(input.integrity)},
               {"figures", json::array()},
               {"frames", json::array()},
               {"refined", json::array()},
               {"truth", json::array()},
               {"worst", json::array()},
               {"map", json()}};
  for (const auto& [name, value] : input.figures) data["figures"].push_back(json::array({name, value}));
  for (std::size_t i = 0; i < input.frames.size(); ++i) {
    data["frames"].push_back(frame_json(input.frames[i], errors[i], input.frame));
    data["truth"].push_back(place_json(input.truth[i], input.frame));
  }
  for (const Estimate& estimate : input.refined) data["refined"].push_back(place_json(estimate.position, input.frame));
  for (const FrameImages& pictures : input.worst) {
    data["worst"].push_back({{"index", pictures.index}, {"frame", pictures.frame_uri}, {"map", pictures.map_uri}});
  }
  if (const auto& map = input.map) {
    data["map"] = {{"image", map->image_uri},
                   {"west", map->west_m},
                   {"north", map->north_m},
                   {"width", map->width_m},
                   {"height", map->height_m}};
    if (input.vectors) data["vectors"] = vectors_json(*input.vectors, *map, input.frame);
  }
  return data;
}

}  // namespace

std::string jpeg_data_uri(const cv::Mat& image, int max_side, int quality) {
  cv::Mat small = image;
  const int side = std::max(image.cols, image.rows);
  if (side > max_side) {
    const double factor = static_cast<double>(max_side) / side;
    cv::resize(image, small, {}, factor, factor, cv::INTER_AREA);
  }
  return "data:image/jpeg;base64," + to_base64(encode_image(small, ImageFormat::jpeg, quality));
}

std::string report_html(const ReportInput& input) {
  const std::string data = script_safe(page_data(input));
  const std::string title = html_escaped(input.title);
  const std::string style = fmt::format("{}\n{}", map_page::leaflet_style, report_page::style);
  const std::string script =
      fmt::format("{}\n{}{}{}", map_page::leaflet_script, report_page::dom, map_page::base_map, report_page::script);
  return fill_page(report_page::html, {{"title", title}, {"style", style}, {"data", data}, {"script", script}});
}

namespace {

constexpr int kFrameSide = 360;  // pixels
constexpr int kFrameQuality = 78;

}  // namespace

void WorstFrames::offer(std::size_t index, double cost, const AnchorReport& anchor) {
  if (anchor.rectified.empty() || anchor.matched_map.empty()) return;
  if (kept_.size() == capacity_ && cost <= kept_.back().cost) return;
  const auto place =
      std::find_if(kept_.begin(), kept_.end(), [cost](const FrameImages& other) { return cost > other.cost; });
  kept_.insert(place, {index, cost, jpeg_data_uri(anchor.rectified, kFrameSide, kFrameQuality),
                       jpeg_data_uri(anchor.matched_map, kFrameSide, kFrameQuality)});
  if (kept_.size() > capacity_) kept_.pop_back();
}

double report_cost(const FrameReport& report, std::optional<double> error_m) {
  if (error_m) return *error_m;
  const bool rejected = report.anchor.verdict != AnchorVerdict::accepted;
  return (rejected ? 10 : 0) + report.anchor.ratio;
}

namespace {

constexpr double kMargin_share = 0.35;  // of the track's longer side, so that there is something to pan to
constexpr double kMinMargin_m = 120;
constexpr double kShape = 1.7;       // width over height
constexpr double kMaxPixels = 1500;  // longer side of the picture
constexpr int kMapQuality = 70;
const cv::Scalar kNoMap(46, 38, 32);  // BGR

}  // namespace

std::optional<ReportMap> report_map(const TileSource& tiles, const LocalFrame& frame, PlaneBox track) {
  const double longer = std::max(track.east_m - track.west_m, track.north_m - track.south_m);
  const double margin = std::max(kMinMargin_m, kMargin_share * longer);
  PlaneBox box{track.west_m - margin, track.south_m - margin, track.east_m + margin, track.north_m + margin};
  // As wide as a laptop shows it.
  const double missing = std::max(0.0, kShape * (box.north_m - box.south_m) - (box.east_m - box.west_m)) / 2;
  box.west_m -= missing;
  box.east_m += missing;
  const double gsd_m = std::max(0.2, std::max(box.east_m - box.west_m, box.north_m - box.south_m) / kMaxPixels);
  const MapWindow window = read_map_window(tiles, frame, box, gsd_m, Colour::bgr);
  if (window.image.empty() || cv::countNonZero(window.mask) == 0) return std::nullopt;
  const cv::Rect covered = cv::boundingRect(window.mask);
  cv::Mat picture = window.image(covered).clone();
  picture.setTo(kNoMap, window.mask(covered) == 0);
  const PlanePoint corner = window.plane_from_pixel(covered.x, covered.y);
  return ReportMap{jpeg_data_uri(picture, static_cast<int>(kMaxPixels) + 2, kMapQuality), corner.east_m, corner.north_m,
                   window.gsd_m * picture.cols, window.gsd_m * picture.rows};
}

}  // namespace nadir
