#include "commands/cache/place_evaluation.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "geodesy/angles.hpp"
#include "replay/flight_folder.hpp"
#include "replay/score.hpp"
#include "vision/place_index_builder.hpp"
#include "vision/rectification.hpp"

namespace nadir {
namespace {

constexpr std::size_t kDeepest = 20;

class Scorer {
 public:
  Scorer(const PlaceIndex& index, PlaceRecall& recall)
      : index_(index), frame_(index.table().origin()), recall_(recall) {}

  void ask(const PlaceQuery& query, LonLat truth) {
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

  void finish() {
    if (times_ms_.empty()) return;
    std::sort(times_ms_.begin(), times_ms_.end());
    recall_.query_ms_p50 = times_ms_[times_ms_.size() / 2];
    recall_.query_ms_max = times_ms_.back();
    recall_.chance_5 /= static_cast<double>(recall_.queries);
  }

 private:
  bool inside(LonLat centre, double side_m, LonLat place) const {
    const PlanePoint a = frame_.plane_from_lonlat(centre), b = frame_.plane_from_lonlat(place);
    return std::abs(a.east_m - b.east_m) <= side_m / 2 && std::abs(a.north_m - b.north_m) <= side_m / 2;
  }
  // 1 − the chance that five different chunks of the layer all miss.
  void blind(LonLat truth, const std::vector<PlaceCandidate>& found) {
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

  const PlaceIndex& index_;
  LocalFrame frame_;
  PlaceRecall& recall_;
  std::vector<double> times_ms_;
};

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

// As another day, sensor and light might show it.
cv::Mat other_day(const cv::Mat& grey, Random& random) {
  cv::Mat changed, noise(grey.size(), CV_32FC1);
  grey.convertTo(changed, CV_32F);
  const double sigma_px = random.uniform(0.3, 1.0);
  cv::GaussianBlur(changed, changed, cv::Size(), sigma_px, sigma_px, cv::BORDER_REFLECT_101);
  const double gain = random.uniform(0.6, 1.3), offset = random.uniform(-30, 30), noise_sigma = random.uniform(3, 10);
  for (int row = 0; row < noise.rows; ++row) {
    for (int column = 0; column < noise.cols; ++column) {
      noise.at<float>(row, column) = static_cast<float>(random.normal(0, noise_sigma));
    }
  }
  changed = changed * gain + noise;
  cv::Mat result;
  changed.convertTo(result, CV_8U, 1, offset);
  return result;
}

// A picture of w x h pixels, turned, in the middle of a mask.
cv::Mat turned_rectangle(cv::Size size, cv::Size2d picture, double heading_rad) {
  cv::Mat mask(size, CV_8UC1, cv::Scalar(0));
  const double cosine = std::cos(heading_rad), sine = std::sin(heading_rad);
  for (int row = 0; row < size.height; ++row) {
    for (int column = 0; column < size.width; ++column) {
      const double x = column + 0.5 - size.width / 2.0, y = row + 0.5 - size.height / 2.0;
      const bool seen =
          std::abs(cosine * x + sine * y) <= picture.width / 2 && std::abs(cosine * y - sine * x) <= picture.height / 2;
      mask.at<std::uint8_t>(row, column) = seen ? 255 : 0;
    }
  }
  return mask;
}

}  // namespace

PlaceEvaluation evaluate_frames(const PlaceIndex& index, const Mission& mission, const std::filesystem::path& folder,
                                const std::optional<std::filesystem::path>& camera, const EvaluationOptions& options,
                                Progress& progress) {
  const Flight flight =
      read_flight({folder / "frames", folder / "telemetry.csv", camera.value_or(folder / "camera.yaml")});
  const Truth truth = read_truth(folder / "truth.csv", flight.frames);
  PlaceEvaluation evaluation;
  Scorer known(index, evaluation.known), unknown(index, evaluation.unknown);
  Random random = Random(options.seed).fork("place evaluation");
  const double gsd_m = finest_gsd_m(index.table());
  progress.begin("asking", flight.frames.size(), "frames");
  for (std::size_t i = 0; i < flight.frames.size(); ++i) {
    progress.advance();
    const Telemetry& row = flight.frames[i];
    const double error_rad = random.uniform(-options.heading_range_rad, options.heading_range_rad);
    const double any_rad = random.uniform(0, 2 * std::numbers::pi);
    const cv::Mat grey = read_grey_image(flight.frames_folder / row.frame);
    if (!truth[i] || grey.empty() || !row.heading_rad) {
      ++evaluation.left_out;
      continue;
    }
    CameraPose pose;
    pose.agl_m = row.agl_m.value_or(mission.route.agl_m);
    pose.attitude = {*row.heading_rad + error_rad, row.pitch_rad.value_or(0), row.roll_rad.value_or(0)};
    if (const auto frame = rectified(grey, flight.camera.camera, pose, gsd_m)) {
      known.ask({frame->image, frame->mask, gsd_m, options.heading_range_rad}, *truth[i]);
    }
    pose.attitude.heading_rad = any_rad;
    if (const auto frame = rectified(grey, flight.camera.camera, pose, gsd_m)) {
      unknown.ask({frame->image, frame->mask, gsd_m, std::nullopt}, *truth[i]);
    }
  }
  progress.end();
  known.finish();
  unknown.finish();
  return evaluation;
}

PlaceEvaluation evaluate_views(const PlaceIndex& index, const TileSource& tiles, std::size_t count,
                               const EvaluationOptions& options, Progress& progress) {
  const PlaceTable& table = index.table();
  PlaceEvaluation evaluation;
  Scorer known(index, evaluation.known), unknown(index, evaluation.unknown);
  Random random = Random(options.seed).fork("place views");
  const LocalFrame frame(table.origin());
  const PlaceLayer& layer = table.layers.front();
  ChunkReader reader(tiles, table.origin());
  progress.begin("asking", count, "views");
  for (std::size_t i = 0; i < count && layer.count > 0; ++i) {
    progress.advance();
    // Anywhere within the middle half of a chunk: where neighbours overlap by half, that is anywhere at all.
    const auto chunk = layer.first + static_cast<std::size_t>(random.uniform() * static_cast<double>(layer.count));
    const PlanePoint middle = frame.plane_from_lonlat(table.chunks[chunk].centre());
    const double north_m = random.uniform(-0.25, 0.25) * layer.side_m();
    const double east_m = random.uniform(-0.25, 0.25) * layer.side_m();
    const LonLat place = frame.lonlat_from_plane({middle.east_m + east_m, middle.north_m + north_m});
    const PlaceChunk view{std::llround(place.lon_deg * 1e7), std::llround(place.lat_deg * 1e7), {}};
    const MapWindow window = reader.around(layer, view, 2.2);
    const cv::Mat grey = other_day(window.image, random);
    const double scale = random.uniform(0.95, 1.05);
    const double heading_rad = random.uniform(0, 2 * std::numbers::pi);
    const double side_px = static_cast<double>(layer.side_px);
    for (PlaceRecall* recall : {&evaluation.known, &evaluation.unknown}) {
      const bool is_known = recall == &evaluation.known;
      const double error_rad = is_known ? random.uniform(-options.heading_range_rad, options.heading_range_rad)
                                        : random.uniform(0, 2 * std::numbers::pi);
      // The picture lies in the assumed north-up frame turned clockwise by the error of its heading.
      PatchPlacement placement;
      placement.centre = {grey.cols / 2.0, grey.rows / 2.0};
      placement.turn_rad = -error_rad;
      placement.pixels_per_px = scale;
      placement.side_px = static_cast<int>(std::lround(1.5 * side_px));
      PlacePatch picture = PatchCutter(grey, window.mask, 1).cut(placement);
      const double root = std::sqrt(4.0 / 3.0);
      picture.mask &= turned_rectangle(picture.mask.size(), {side_px * root, side_px / root}, heading_rad);
      (is_known ? known : unknown)
          .ask({picture.grey, picture.mask, layer.gsd_m(),
                is_known ? std::optional<double>(options.heading_range_rad) : std::nullopt},
               place);
    }
  }
  progress.end();
  known.finish();
  unknown.finish();
  return evaluation;
}

}  // namespace nadir
