#include "flight_adjustment/tie_features.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "adjustment/adjustment_parameters.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/sift_features.hpp"

namespace nadir {
namespace {

using namespace parameters::ties;

// Indices of features, strongest first, so that cells of a grid take turns: the strongest of each, then the second …
std::vector<std::size_t> spread(const std::vector<cv::Point2f>& points, const cv::Size& size, std::size_t most) {
  std::vector<std::size_t> of_cell(kGridColumns * kGridRows, 0);
  std::vector<std::pair<std::size_t, std::size_t>> order;  // rank within its cell, index
  order.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto along = [](float at, int side, std::size_t cells) {
      const double share = std::clamp(static_cast<double>(at) / side, 0.0, 1.0);
      return std::min(cells - 1, static_cast<std::size_t>(share * static_cast<double>(cells)));
    };
    const std::size_t cell =
        along(points[i].y, size.height, kGridRows) * kGridColumns + along(points[i].x, size.width, kGridColumns);
    order.emplace_back(of_cell[cell]++, i);
  }
  std::sort(order.begin(), order.end());
  if (order.size() > most) order.resize(most);
  std::vector<std::size_t> kept;
  for (const auto& entry : order) kept.push_back(entry.second);
  return kept;
}

}  // namespace

CameraModel tie_camera(const CameraModel& camera) {
  const double factor = std::min(1.0, kWorkingSide_px / std::max(camera.width, camera.height));
  return factor < 1 ? camera.scaled(factor) : camera;
}

TieFeatures tie_features(const cv::Mat& grey, const CameraModel& camera) {
  TieFeatures result;
  if (grey.empty()) return result;
  const cv::Size size(camera.width, camera.height);
  cv::Mat working = grey;
  if (grey.size() != size) cv::resize(grey, working, size, 0, 0, cv::INTER_AREA);
  using namespace parameters::visual_odometry;
  const SiftFeatures found = sift_features(working, {kDetectedFeatures, kOctaveLayers, kSiftContrast});
  for (const std::size_t i : spread(found.points, size, kKeptFeatures)) {
    result.points.push_back(found.points[i]);
    const std::int16_t* values = found.descriptors.at(i);
    for (std::size_t k = 0; k < TieFeatures::kLength; ++k) {
      result.descriptors.push_back(static_cast<std::uint8_t>(std::clamp<int>(values[k], 0, 255)));
    }
  }
  return result;
}

}  // namespace nadir
