// Masked, normalised cross-correlation of multi-channel pictures by FFT (after Padfield 2012, per channel and summed).
//
// For every placement of the template inside the window:
//   score = Σ_c Σ_x (T_c(x) − mean T_c)(M_c(x+u) − mean M_c(u)) / (|T| |M(u)|)
// with all means and norms under the template's mask. Subtracting each channel's mean matters: without it the score
// follows the map's texture density and is hundreds of metres off.
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "vision/oriented_channels.hpp"

namespace nadir {

// The window's side of the correlation, computed once and used for every heading and scale of the template.
class WindowSpectra {
 public:
  explicit WindowSpectra(const Channels& window);

  cv::Size window_size() const { return window_size_; }

 private:
  friend class TemplateNorm;
  friend cv::Mat correlate(const Channels&, const WindowSpectra&, const class TemplateNorm&);

  cv::Size window_size_;
  cv::Size fft_size_;
  bool means_removed_;
  std::vector<cv::Mat> pairs_;  // spectra of the channel pairs, each channel's global mean removed
  cv::Mat energy_and_valid_;    // spectrum of (sum of squares, 1 where valid) as one complex image
};

// The denominator for one template mask. It varies slowly with heading and scale, so a sweep may share one; use the
// template's own for exact scores.
class TemplateNorm {
 public:
  // min_valid: share of the template that must lie on valid map for a placement to count.
  TemplateNorm(const Channels& shape, const WindowSpectra& window, double min_valid = 0.6);

 private:
  friend cv::Mat correlate(const Channels&, const WindowSpectra&, const TemplateNorm&);
  cv::Size template_size_;
  cv::Mat inverse_norm_;  // 1 / |M(u)|, 0 where the placement does not count
};

// Scores (CV_32FC1) of every placement: pixel (x, y) is for the template's top-left corner at (x, y) of the window.
// Size: window − template + 1. Placements that do not count score −1. The template must fit into the window and have
// the size that `norm` was made for.
cv::Mat correlate(const Channels& pattern, const WindowSpectra& window, const TemplateNorm& norm);

// A local maximum of a score surface, to a fraction of a pixel (parabola through the neighbours).
struct Peak {
  double x = 0;
  double y = 0;
  double score = -1;
  double curvature_x = 0;  // −d²score/dx² per pixel², larger is sharper
  double curvature_y = 0;
};

Peak best_peak(const cv::Mat& scores);

// The strongest maxima that are at least min_distance_px apart, best first.
std::vector<Peak> distinct_peaks(const cv::Mat& scores, std::size_t count, double min_distance_px);

}  // namespace nadir
