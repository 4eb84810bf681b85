// Masked, normalised cross-correlation of multi-channel images (after Padfield 2012, per channel and summed).
//
// For every placement of the template inside the window:
//   score = Σ_c Σ_x (T_c(x) − mean T_c)(M_c(x+u) − mean M_c(u)) / (|T| |M(u)|)
// with all means and norms under the template's mask. Subtracting each channel's mean matters: without it the score
// follows the map's texture density and is hundreds of metres off.
//
// Two implementations of one score: by FFT for all placements in a window (WindowSpectra, TemplateSpectra), and as a
// direct sum over integers for the few placements around an expected position (LocalTemplate), where that is far
// cheaper, and the same on every processor.
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "imagery/fourier.hpp"
#include "vision/oriented_channels.hpp"
#include "vision/quantized_channels.hpp"

namespace nadir {

// The window's side of the correlation, computed once and used for every heading and scale of the template. A window
// that is much larger than the template is transformed in overlapping parts, each for its share of the placements.
class WindowSpectra {
 public:
  // For templates of that size; empty: of any.
  explicit WindowSpectra(const Channels& window, cv::Size pattern = {});

  cv::Size window_size() const { return window_size_; }

 private:
  friend class TemplateNorm;
  friend class TemplateSpectra;

  struct Part {
    cv::Rect placements;
    std::vector<Spectrum> channels;  // each channel's global mean removed
    Spectrum energy_and_valid;       // of (sum of squares, 1 where valid) as one complex image
  };

  cv::Size window_size_;
  cv::Size pattern_;
  bool means_removed_;
  FourierTransform transform_;
  std::vector<Part> parts_;
};

// The denominator for one template mask. It varies slowly with heading and scale, so a sweep may share one; use the
// template's own for exact scores.
class TemplateNorm {
 public:
  // min_valid: share of the template that must lie on valid map for a placement to count.
  TemplateNorm(const Channels& shape, const WindowSpectra& window, double min_valid = kMinValidShare);

 private:
  friend class TemplateSpectra;
  cv::Size template_size_;
  cv::Mat inverse_norm_;  // 1 / |M(u)|, 0 where the placement does not count
};

// The template's side: one or two templates, transformed once for any number of windows of one size. Two take little
// more than one: with W the spectrum of a real channel of the window, and a and b that channel of both templates, the
// inverse transform of W · conj(spectrum of a - ib) is (their product with a) + i (that with b).
class TemplateSpectra {
 public:
  // window: one of those; the template fits into it. other: of the same size, or null.
  TemplateSpectra(const Channels& one, const Channels* other, const WindowSpectra& window);

  // Scores (CV_32FC1) of every placement for each template: pixel (x, y) is for the template's top-left corner at (x,
  // y) of the window. Size: window − template + 1. Placements that do not count score −1. The template must have the
  // size that `norm` was made for.
  std::vector<cv::Mat> scores(const WindowSpectra& window, const TemplateNorm& norm) const;

 private:
  cv::Size template_size_, window_size_;
  std::vector<Spectrum> channels_;
  std::vector<float> inverse_norms_;  // of each template
};

// Of one template in one window.
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

// A part of an image as the template of direct correlations.
class LocalTemplate {
 public:
  // `part` lies inside.
  LocalTemplate(const QuantizedChannels& of, const cv::Rect& part);

  // Scores (CV_32FC1) with the template's top-left corner at `first` of `window` and at placements.width - 1 further
  // ones to the right and placements.height - 1 down, `step` pixels apart, all inside the window. -1 where less than
  // `min_valid` of the template lies on valid pixels of the window.
  cv::Mat scores(const QuantizedChannels& window, cv::Point first, cv::Size placements,
                 double min_valid = kMinValidShare, int step = 1) const;

 private:
  struct Run {  // of valid pixels in a row of the template
    int row = 0, begin = 0, end = 0;
    std::size_t at = 0, blocks = 0;  // in values_
  };
  struct RunSums;
  struct WindowSums;
  class Columns;
  class Rows;

  void add_run(int row, int begin, int end, const std::int16_t* values, RunSums& sums);

  cv::Rect part_;
  std::size_t channels_ = 0;
  bool means_removed_ = true;
  std::vector<Run> runs_;
  std::vector<std::int16_t> values_;  // of the runs, one after the other, each filled up with zeros
  double pixels_ = 0;
  double energy_ = 0;         // sum of squares, the channels' means removed
  std::vector<double> sums_;  // of each channel
};

// The channels of a region of the map, computed once for all templates that are compared with it.
class MapChannels {
 public:
  // image: grey; mask: 0 where there is no map. Both are shared, not copied.
  MapChannels(cv::Mat image, cv::Mat mask, ChannelSet set, const ChannelOptions& options);

  cv::Size map_size() const { return image_.size(); }
  // Computes them over `part` of the map's pixels and a margin, unless they are there already. What lies beyond the map
  // is not valid.
  void cover(const cv::Rect& part);
  // Of the region covered last, and where in it a pixel of the map lies.
  const QuantizedChannels& channels() const { return *channels_; }
  // The same at half the resolution.
  const QuantizedChannels& half();
  cv::Point inside(cv::Point map_pixel) const { return map_pixel - part_.tl(); }

 private:
  cv::Mat image_, mask_;
  ChannelSet set_;
  ChannelOptions options_;
  cv::Rect part_;
  std::optional<QuantizedChannels> channels_, half_;
};

}  // namespace nadir
