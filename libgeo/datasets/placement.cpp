#include "datasets/placement.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "base/quantile.hpp"
#include "base/random.hpp"
#include "estimation/look_likelihood.hpp"
#include "geodesy/angles.hpp"
#include "replay/replay_flight.hpp"
#include "vision/camera_frame.hpp"
#include "vision/map_matcher.hpp"
#include "vision/place_index_builder.hpp"

namespace nadir {
namespace {

using parameters::belief::kUnambiguous;
using parameters::search_window::kHeadingSigmas;
using parameters::search_window::kScaleSigmas;

constexpr double kDrawnShare = 0.8;           // of the half side: how far off the searched square's middle may be
constexpr double kUnmeasuredTilt_rad = 0.35;  // σ of a tilt that the dataset does not state

LocalFrame plane_of(const RasterTiles& tiles) {
  const LonLatBox box = tiles.bounds();
  return LocalFrame({(box.west_deg + box.east_deg) / 2, (box.south_deg + box.north_deg) / 2});
}

AnchorPrior prior_of(const Telemetry& telemetry, const TelemetryUncertainty& stated, PlanePoint middle,
                     double search_m) {
  AnchorPrior prior;
  prior.search.pose.position = middle;
  prior.search.pose.agl_m = *telemetry.agl_m;
  prior.search.pose.attitude = {telemetry.heading_rad.value_or(0), telemetry.pitch_rad.value_or(0),
                                telemetry.roll_rad.value_or(0)};
  prior.search.radius_m = search_m;
  prior.heading_sigma_rad = telemetry.heading_rad ? stated.heading_rad : kPi;
  prior.search.heading_range_rad = telemetry.heading_rad ? kHeadingSigmas * stated.heading_rad : kPi;
  prior.log_agl_sigma = stated.agl_relative;
  prior.search.scale_range = kScaleSigmas * stated.agl_relative;
  const bool measured = telemetry.pitch_rad && telemetry.roll_rad;
  const double tilt_rad = measured ? stated.tilt_rad : kUnmeasuredTilt_rad;
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * tilt_rad * tilt_rad;
  return prior;
}

PlanePoint drawn_around(PlanePoint truth, double search_m, Random random) {
  const double reach_m = kDrawnShare * search_m;
  const double east_m = random.uniform(-reach_m, reach_m);
  return {truth.east_m + east_m, truth.north_m + random.uniform(-reach_m, reach_m)};
}

void set_position(PlacedFrame& placed, const LocalFrame& frame, PlanePoint at) {
  placed.position = frame.lonlat_from_plane(at);
  placed.error_m = distance_m(at, frame.plane_from_lonlat(placed.truth));
}

double share(std::size_t part, std::size_t of) {
  return of == 0 ? 0 : static_cast<double>(part) / static_cast<double>(of);
}

double mean_of(const std::vector<double>& values) {
  return values.empty() ? 0 : std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

std::string percent(std::size_t part, std::size_t of) { return fmt::format("{:.1f} %", 100 * share(part, of)); }

std::vector<TileKey> finest_tiles(const RasterTiles& tiles) {
  const LonLatBox box = tiles.bounds();
  const int zoom = tiles.zooms().max;
  const TileKey first = tile_at({box.west_deg, box.north_deg}, zoom),
                last = tile_at({box.east_deg, box.south_deg}, zoom);
  std::vector<TileKey> keys;
  for (std::uint32_t x = first.x; x <= last.x; ++x) {
    for (std::uint32_t y = first.y; y <= last.y; ++y) keys.push_back({static_cast<std::uint8_t>(zoom), x, y});
  }
  std::sort(keys.begin(), keys.end());
  return keys;
}

}  // namespace

std::vector<PlacedFrame> place_frames(const DatasetFlight& from, const RasterTiles& tiles,
                                      const PlacementOptions& options, Progress& progress) {
  const LocalFrame frame = plane_of(tiles);
  const CameraModel& camera = from.flight.camera.camera;
  const int shrink = decode_reduction(camera.width, camera.height);
  const CameraModel decoded = camera.scaled(1.0 / shrink);
  const FlatGround flat;
  const auto matcher = make_channel_matcher({decoded, tiles, frame, flat});
  const Random seeded(options.seed);
  std::vector<PlacedFrame> result;
  progress.begin("placing frames of " + from.name, from.flight.frames.size(), "frames");
  for (std::size_t i = 0; i < from.flight.frames.size(); ++i) {
    const Telemetry& telemetry = from.flight.frames[i];
    PlacedFrame placed;
    placed.name = telemetry.frame;
    placed.truth = *from.truth[i];
    placed.verdict = "unreadable";
    const std::int64_t began_ms = options.clock();
    const cv::Mat grey = read_flight_image(from.flight.image_path(i), decoded, shrink);
    if (!grey.empty()) {
      const PlanePoint middle =
          drawn_around(frame.plane_from_lonlat(placed.truth), options.search_m, seeded.fork(telemetry.frame));
      const AnchorPrior prior = prior_of(telemetry, from.flight.camera.uncertainty, middle, options.search_m);
      const AnchorMatch match = matcher->match(grey, prior);
      placed.verdict = match.on_map ? "no_candidate" : "no_map";
      if (match.solved) {
        const PlaneBox searched = square_around(middle, options.search_m);
        placed.log_likelihood_ratio = log_likelihood_ratio(features_of(match, prior, searched.area_m2()));
        placed.accepted = placed.log_likelihood_ratio >= kUnambiguous;
        placed.verdict = placed.accepted ? "accepted" : "doubtful";
        set_position(placed, frame, match.solved->pose.position);
      }
    }
    placed.ms = static_cast<double>(options.clock() - began_ms);
    result.push_back(std::move(placed));
    progress.advance();
  }
  progress.end();
  return result;
}

std::vector<PlacedFrame> place_flight(const DatasetFlight& from, const RasterTiles& tiles, Progress& progress) {
  ReplaySetup setup{.frame = plane_of(tiles), .tiles = &tiles, .start = from.truth.front(), .area = std::nullopt};
  const LonLatBox box = tiles.bounds();
  const PlanePoint south_west = setup.frame.plane_from_lonlat({box.west_deg, box.south_deg}),
                   north_east = setup.frame.plane_from_lonlat({box.east_deg, box.north_deg});
  setup.area = PlaneBox{south_west.east_m, south_west.north_m, north_east.east_m, north_east.north_m};
  const ReplayedFlight flown = replay_flight(from.flight, setup, from.truth, nullptr, progress);
  std::vector<PlacedFrame> result;
  for (std::size_t i = 0; i < flown.frames.size(); ++i) {
    const Estimate& estimate = flown.frames[i].estimate;
    PlacedFrame placed;
    placed.name = from.flight.frames[i].frame;
    placed.truth = *from.truth[i];
    placed.verdict = "no_candidate";
    placed.ms = estimate.latency_ms;
    if (estimate.position) {
      set_position(placed, setup.frame, setup.frame.plane_from_lonlat(*estimate.position));
      placed.accepted = estimate.source == SourceLabel::satellite_anchored;
      placed.verdict = placed.accepted ? "accepted" : "doubtful";
    }
    result.push_back(std::move(placed));
  }
  return result;
}

MapRecall map_recall(std::span<const DatasetFlight> from, const RasterTiles& tiles, const PlacementOptions& options,
                     int threads, Progress& progress) {
  std::vector<double> sides_m, heights_m;
  std::vector<FlightWithTruth> flights;
  for (const DatasetFlight& one : from) {
    const CameraModel& camera = one.flight.camera.camera;
    flights.push_back({one.flight, one.truth});
    for (const Telemetry& telemetry : one.flight.frames) {
      heights_m.push_back(*telemetry.agl_m);
      sides_m.push_back(
          place_footprint_m(*telemetry.agl_m * camera.width / camera.fx, *telemetry.agl_m * camera.height / camera.fy));
    }
  }
  PlaceIndexOptions layout;
  layout.footprints_m = {quantile(sides_m, 0.5)};
  layout.threads = threads;
  const PlaceIndex index = build_place_index(
      {.tiles = &tiles, .keys = finest_tiles(tiles), .merkle_root = {}, .origin = plane_of(tiles).origin()}, layout,
      progress);
  return {index.table().chunks.size(),
          evaluate_frames(index, flights, quantile(heights_m, 0.5), {.seed = options.seed}, progress)};
}

PlacementFigures figures_of(const std::vector<PlacedFrame>& frames) {
  PlacementFigures figures;
  std::vector<double> errors_m, candidate_errors_m, ms;
  for (const PlacedFrame& frame : frames) {
    ++figures.frames;
    ms.push_back(frame.ms);
    if (!frame.position) continue;
    ++figures.candidates;
    candidate_errors_m.push_back(frame.error_m);
    for (std::size_t i = 0; i < kWithin_m.size(); ++i) {
      if (frame.error_m > kWithin_m[i]) continue;
      ++figures.within[i];
      if (frame.accepted) ++figures.accepted_within[i];
    }
    if (!frame.accepted) continue;
    ++figures.accepted;
    errors_m.push_back(frame.error_m);
    if (frame.error_m > kWrongAnchor_m) ++figures.wrong;
  }
  figures.median_m = quantile(errors_m, 0.5);
  figures.p95_m = quantile(errors_m, 0.95);
  figures.mean_m = mean_of(errors_m);
  figures.candidate_median_m = quantile(candidate_errors_m, 0.5);
  figures.ms_median = quantile(ms, 0.5);
  figures.ms_mean = mean_of(ms);
  return figures;
}

nlohmann::json json_from(const PlacementFigures& figures) {
  nlohmann::json document{{"frames", figures.frames},
                          {"candidates", figures.candidates},
                          {"accepted", figures.accepted},
                          {"wrong", figures.wrong},
                          {"median_m", rounded(figures.median_m)},
                          {"mean_m", rounded(figures.mean_m)},
                          {"p95_m", rounded(figures.p95_m)},
                          {"candidate_median_m", rounded(figures.candidate_median_m)},
                          {"ms_median", rounded(figures.ms_median)},
                          {"ms_mean", rounded(figures.ms_mean)}};
  for (std::size_t i = 0; i < kWithin_m.size(); ++i) {
    document[fmt::format("within_{:.0f}_m_share", kWithin_m[i])] = rounded(share(figures.within[i], figures.frames));
    document[fmt::format("accepted_within_{:.0f}_m_share", kWithin_m[i])] =
        rounded(share(figures.accepted_within[i], figures.frames));
  }
  return document;
}

Figures table_of(const PlacementFigures& figures) {
  Figures table{{"frames", std::to_string(figures.frames)},
                {"with a candidate", percent(figures.candidates, figures.frames)},
                {"accepted", percent(figures.accepted, figures.frames)}};
  for (std::size_t i = 0; i < kWithin_m.size(); ++i) {
    table.emplace_back(fmt::format("within {:.0f} m", kWithin_m[i]),
                       fmt::format("{}, accepted {}", percent(figures.within[i], figures.frames),
                                   percent(figures.accepted_within[i], figures.frames)));
  }
  table.emplace_back(fmt::format("accepted, more than {:.0f} m off", kWrongAnchor_m), std::to_string(figures.wrong));
  table.emplace_back("error of the accepted", figures.accepted == 0
                                                  ? "none accepted"
                                                  : fmt::format("median {:.1f} m, mean {:.1f} m, 95 % {:.1f} m",
                                                                figures.median_m, figures.mean_m, figures.p95_m));
  table.emplace_back("error of all candidates", fmt::format("median {:.1f} m", figures.candidate_median_m));
  table.emplace_back("time of a frame",
                     fmt::format("median {:.0f} ms, mean {:.0f} ms", figures.ms_median, figures.ms_mean));
  return table;
}

std::string csv_of(const std::vector<PlacedFrame>& frames) {
  std::string text = "frame,verdict,error_m,log_likelihood_ratio,lat_deg,lon_deg,truth_lat_deg,truth_lon_deg,ms\n";
  for (const PlacedFrame& frame : frames) {
    text += fmt::format("{},{},", frame.name, frame.verdict);
    text += frame.position ? fmt::format("{:.3f},{:.3f},{:.8f},{:.8f},", frame.error_m, frame.log_likelihood_ratio,
                                         frame.position->lat_deg, frame.position->lon_deg)
                           : ",,,,";
    text += fmt::format("{:.8f},{:.8f},{:.0f}\n", frame.truth.lat_deg, frame.truth.lon_deg, frame.ms);
  }
  return text;
}

}  // namespace nadir
