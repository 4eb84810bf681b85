#include "ortho/seam.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace nadir {
namespace {

constexpr int kCell_px = 4;             // the square's grain
constexpr int kLeastTemplate_px = 24;   // less structure than that says nothing
constexpr double kLeastContrast = 3;    // grey levels: below it is the sensor's noise
constexpr int kLargestSquare_px = 160;  // more says nothing new

// The largest square of cells that are all common, in pixels; of several the first.
cv::Rect largest_square(const cv::Mat& common) {
  const int rows = common.rows / kCell_px, columns = common.cols / kCell_px;
  cv::Mat_<int> side(rows, columns, 0);
  int best = 0;
  cv::Point end;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const cv::Mat cell = common(cv::Rect(c * kCell_px, r * kCell_px, kCell_px, kCell_px));
      if (cv::countNonZero(cell) != kCell_px * kCell_px) continue;
      side(r, c) = r == 0 || c == 0 ? 1 : 1 + std::min({side(r - 1, c), side(r, c - 1), side(r - 1, c - 1)});
      if (side(r, c) > best) best = side(r, c), end = {c + 1, r + 1};
    }
  }
  return {(end.x - best) * kCell_px, (end.y - best) * kCell_px, best * kCell_px, best * kCell_px};
}

cv::Mat grey_part(const cv::Mat& picture, const cv::Rect& part) {
  cv::Mat grey;
  cv::cvtColor(picture(part), grey, cv::COLOR_BGR2GRAY);
  return grey;
}

// Of a parabola through three neighbours, from the middle one.
double vertex(double before, double at, double after) {
  const double bend = before - 2 * at + after;
  return bend < 0 ? std::clamp((before - after) / bend / 2, -0.5, 0.5) : 0;
}

}  // namespace

std::optional<Seam> measure_seam(const cv::Mat& one, const cv::Mat& other, const cv::Mat& common, int reach_px) {
  cv::Rect square = largest_square(common);
  if (square.width < kLeastTemplate_px + 2 * reach_px) return std::nullopt;
  if (const int off = square.width - std::max(kLargestSquare_px, kLeastTemplate_px + 2 * reach_px); off > 0) {
    square = {square.x + off / 2, square.y + off / 2, square.width - off, square.height - off};
  }
  const int inner = square.width - 2 * reach_px;
  const cv::Mat pattern = grey_part(one, {square.x + reach_px, square.y + reach_px, inner, inner});
  cv::Scalar mean, deviation;
  cv::meanStdDev(pattern, mean, deviation);
  if (deviation[0] < kLeastContrast) return Seam{};
  cv::Mat scores;
  cv::matchTemplate(grey_part(other, square), pattern, scores, cv::TM_CCOEFF_NORMED);
  double best = 0;
  cv::Point at;
  cv::minMaxLoc(scores, nullptr, &best, nullptr, &at);
  if (!std::isfinite(best)) return Seam{};
  double dx = at.x - reach_px, dy = at.y - reach_px;
  const auto score = [&](int x, int y) { return static_cast<double>(scores.at<float>(y, x)); };
  if (at.x > 0 && at.x + 1 < scores.cols) dx += vertex(score(at.x - 1, at.y), best, score(at.x + 1, at.y));
  if (at.y > 0 && at.y + 1 < scores.rows) dy += vertex(score(at.x, at.y - 1), best, score(at.x, at.y + 1));
  return Seam{std::hypot(dx, dy), best};
}

}  // namespace nadir
