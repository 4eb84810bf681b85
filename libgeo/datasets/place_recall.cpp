#include "datasets/place_recall.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "base/random.hpp"
#include "vision/rectification.hpp"

namespace nadir {
namespace {

constexpr std::size_t kDeepest = 20;

// The smallest layer's resolution: fine enough for every layer.
double finest_gsd_m(const PlaceTable& table) {
  double gsd_m = table.layers.front().gsd_m();
  for (const PlaceLayer& layer : table.layers) gsd_m = std::min(gsd_m, layer.gsd_m());
  return gsd_m;
}

std::optional<RectifiedFrame> rectified(const cv::Mat& grey, const CameraModel& camera, const CameraPose& pose,
                                        double gsd_m) {
  const auto box = footprint_of(camera, pose);
  if (!box) return std::nullopt;
  GroundGrid grid;
  grid.gsd_m = gsd_m;
  grid.west_m = box->west_m;
  grid.north_m = box->north_m;
  grid.columns = static_cast<int>(std::ceil((box->east_m - box->west_m) / gsd_m));
  grid.rows = static_cast<int>(std::ceil((box->north_m - box->south_m) / gsd_m));
  return rectify(reduce_frame(grey, camera, pose.agl_m, gsd_m), pose, grid);
}

}  // namespace

PlaceScorer::PlaceScorer(const PlaceIndex& index, PlaceRecall& recall)
    : index_(index), frame_(index.table().origin()), recall_(recall) {}

void PlaceScorer::ask(const PlaceQuery& query, LonLat truth) {
  const auto begin = std::chrono::steady_clock::now();
  const std::vector<PlaceCandidate> found = index_.query(query, kDeepest);
  times_ms_.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
  const auto hit = std::find_if(found.begin(), found.end(), [&](const PlaceCandidate& candidate) {
    return inside(candidate.centre, candidate.side_m, truth);
  });
  const std::size_t rank = hit == found.end() ? kDeepest : static_cast<std::size_t>(hit - found.begin());
  ++recall_.queries;
  recall_.within_1 += rank < 1;
  recall_.within_5 += rank < 5;
  recall_.within_20 += rank < 20;
  blind(truth, found);
}

void PlaceScorer::finish() {
  if (times_ms_.empty()) return;
  std::sort(times_ms_.begin(), times_ms_.end());
  recall_.query_ms_p50 = times_ms_[times_ms_.size() / 2];
  recall_.query_ms_max = times_ms_.back();
  recall_.chance_5 /= static_cast<double>(recall_.queries);
}

bool PlaceScorer::inside(LonLat centre, double side_m, LonLat place) const {
  const PlanePoint a = frame_.plane_from_lonlat(centre), b = frame_.plane_from_lonlat(place);
  return std::abs(a.east_m - b.east_m) <= side_m / 2 && std::abs(a.north_m - b.north_m) <= side_m / 2;
}

// 1 − the chance that five different chunks of the layer all miss.
void PlaceScorer::blind(LonLat truth, const std::vector<PlaceCandidate>& found) {
  if (found.empty()) return;
  const auto& layers = index_.table().layers;
  const auto layer = std::find_if(layers.begin(), layers.end(),
                                  [&](const PlaceLayer& one) { return found.front().chunk < one.first + one.count; });
  double right = 0;
  for (std::size_t i = layer->first; i < layer->first + layer->count; ++i) {
    right += inside(index_.table().chunks[i].centre(), layer->side_m(), truth);
  }
  double miss = 1;
  const auto all = static_cast<double>(layer->count);
  for (int i = 0; i < 5 && i < static_cast<int>(layer->count); ++i) {
    miss *= std::max(0.0, (all - right - i) / (all - i));
  }
  recall_.chance_5 += 1 - miss;
}

PlaceEvaluation evaluate_frames(const PlaceIndex& index, std::span<const FlightWithTruth> flights, double usual_agl_m,
                                const PlaceRecallOptions& options, Progress& progress) {
  PlaceEvaluation evaluation;
  PlaceScorer known(index, evaluation.known), unknown(index, evaluation.unknown);
  Random random = Random(options.seed).fork("place evaluation");
  const double gsd_m = finest_gsd_m(index.table());
  std::size_t frames = 0;
  for (const FlightWithTruth& one : flights) frames += one.flight.frames.size();
  progress.begin("asking", frames, "frames");
  for (const auto& [flight, truth] : flights) {
    for (std::size_t i = 0; i < flight.frames.size(); ++i) {
      progress.advance();
      const Telemetry& row = flight.frames[i];
      const double error_rad = random.uniform(-options.heading_range_rad, options.heading_range_rad);
      const double any_rad = random.uniform(0, 2 * std::numbers::pi);
      const cv::Mat grey = read_grey_image(flight.image_path(i));
      if (!truth[i] || grey.empty() || !row.heading_rad) {
        ++evaluation.left_out;
        continue;
      }
      CameraPose pose;
      pose.agl_m = row.agl_m.value_or(usual_agl_m);
      pose.attitude = {*row.heading_rad + error_rad, row.pitch_rad.value_or(0), row.roll_rad.value_or(0)};
      if (const auto frame = rectified(grey, flight.camera.camera, pose, gsd_m)) {
        known.ask({frame->image, frame->mask, gsd_m, options.heading_range_rad}, *truth[i]);
      }
      pose.attitude.heading_rad = any_rad;
      if (const auto frame = rectified(grey, flight.camera.camera, pose, gsd_m)) {
        unknown.ask({frame->image, frame->mask, gsd_m, std::nullopt}, *truth[i]);
      }
    }
  }
  progress.end();
  known.finish();
  unknown.finish();
  return evaluation;
}

nlohmann::json json_from(const PlaceRecall& recall) {
  return {{"queries", recall.queries},
          {"recall_at_1", recall.share(recall.within_1)},
          {"recall_at_5", recall.share(recall.within_5)},
          {"recall_at_20", recall.share(recall.within_20)},
          {"chance_at_5", recall.chance_5},
          {"query_ms_p50", recall.query_ms_p50},
          {"query_ms_max", recall.query_ms_max}};
}

std::string text_from(const PlaceRecall& recall) {
  return fmt::format(
      "recall@1 {:.1f} %, @5 {:.1f} % (chance {:.1f} %), @20 {:.1f} %; {:.0f} ms per query, at most {:.0f} ms",
      100 * recall.share(recall.within_1), 100 * recall.share(recall.within_5), 100 * recall.chance_5,
      100 * recall.share(recall.within_20), recall.query_ms_p50, recall.query_ms_max);
}

}  // namespace nadir
