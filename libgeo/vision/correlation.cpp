#include "vision/correlation.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace nadir {
namespace {

cv::Mat spectrum_of(const cv::Mat& complex, cv::Size fft_size) {
  cv::Mat padded = cv::Mat::zeros(fft_size, CV_32FC2);
  complex.copyTo(padded(cv::Rect(0, 0, complex.cols, complex.rows)));
  cv::dft(padded, padded, 0, complex.rows);
  return padded;
}

// The correlation with a template's spectrum, cut to the placements that lie inside the window.
cv::Mat inverse(cv::Mat product, cv::Size placements) {
  cv::dft(product, product, cv::DFT_INVERSE | cv::DFT_SCALE);
  return product(cv::Rect(cv::Point(0, 0), placements));
}

cv::Mat product_with_conjugate(const cv::Mat& window, const cv::Mat& pattern) {
  cv::Mat product;
  cv::mulSpectrums(window, pattern, product, 0, true);
  return product;
}

cv::Mat real_complex(const cv::Mat& real) {
  cv::Mat complex;
  cv::merge(std::vector<cv::Mat>{real, cv::Mat::zeros(real.size(), CV_32FC1)}, complex);
  return complex;
}

cv::Mat unit_mask(const cv::Mat& mask) {
  cv::Mat unit;
  mask.convertTo(unit, CV_32F, 1.0 / 255.0);
  return unit;
}

cv::Size placements_of(cv::Size window, cv::Size pattern) {
  return {window.width - pattern.width + 1, window.height - pattern.height + 1};
}

// Subtracts the mean under the mask and clears the rest.
cv::Mat centred(const cv::Mat& pair, const cv::Mat& mask, bool means_removed) {
  cv::Mat result = pair - (means_removed ? cv::mean(pair, mask) : cv::Scalar());
  result.setTo(cv::Scalar::all(0), mask == 0);
  return result;
}

float parabola_offset(float before, float here, float after, double& curvature) {
  const float bend = before - 2 * here + after;
  curvature = -static_cast<double>(bend);
  if (bend >= -1e-9F) return 0;
  return std::clamp(0.5F * (before - after) / bend, -0.5F, 0.5F);
}

Peak refined_peak(const cv::Mat& scores, cv::Point at) {
  Peak peak;
  peak.score = static_cast<double>(scores.at<float>(at));
  peak.x = at.x;
  peak.y = at.y;
  const float here = scores.at<float>(at);
  if (at.x > 0 && at.x + 1 < scores.cols) {
    peak.x += static_cast<double>(
        parabola_offset(scores.at<float>(at.y, at.x - 1), here, scores.at<float>(at.y, at.x + 1), peak.curvature_x));
  }
  if (at.y > 0 && at.y + 1 < scores.rows) {
    peak.y += static_cast<double>(
        parabola_offset(scores.at<float>(at.y - 1, at.x), here, scores.at<float>(at.y + 1, at.x), peak.curvature_y));
  }
  return peak;
}

}  // namespace

WindowSpectra::WindowSpectra(const Channels& window)
    : window_size_(window.mask.size()),
      fft_size_(cv::getOptimalDFTSize(window.mask.cols), cv::getOptimalDFTSize(window.mask.rows)),
      means_removed_(window.means_removed) {
  cv::Mat energy = cv::Mat::zeros(window_size_, CV_32FC1);
  for (const cv::Mat& pair : window.pairs) {
    const cv::Mat levelled = centred(pair, window.mask, means_removed_);
    cv::Mat parts[2];
    cv::split(levelled, parts);
    energy += parts[0].mul(parts[0]) + parts[1].mul(parts[1]);
    pairs_.push_back(spectrum_of(levelled, fft_size_));
  }
  cv::Mat both;
  cv::merge(std::vector<cv::Mat>{energy, unit_mask(window.mask)}, both);
  energy_and_valid_ = spectrum_of(both, fft_size_);
}

TemplateNorm::TemplateNorm(const Channels& shape, const WindowSpectra& window, double min_valid)
    : template_size_(shape.mask.size()) {
  const cv::Size placements = placements_of(window.window_size_, template_size_);
  CV_Assert(placements.width > 0 && placements.height > 0);
  const cv::Mat mask = spectrum_of(real_complex(unit_mask(shape.mask)), window.fft_size_);
  const cv::Mat sums = inverse(product_with_conjugate(window.energy_and_valid_, mask), placements);
  cv::Mat means_squared = cv::Mat::zeros(placements, CV_32FC1);
  for (const cv::Mat& pair : window.pairs_) {
    if (!window.means_removed_) break;
    const cv::Mat sum = inverse(product_with_conjugate(pair, mask), placements);
    for (int r = 0; r < placements.height; ++r) {
      const auto* from = sum.ptr<cv::Vec2f>(r);
      auto* to = means_squared.ptr<float>(r);
      for (int c = 0; c < placements.width; ++c) to[c] += from[c][0] * from[c][0] + from[c][1] * from[c][1];
    }
  }
  const auto area = static_cast<float>(std::max(1, cv::countNonZero(shape.mask)));
  const auto needed = static_cast<float>(min_valid) * area;
  inverse_norm_.create(placements, CV_32FC1);
  for (int r = 0; r < placements.height; ++r) {
    const auto* energy_valid = sums.ptr<cv::Vec2f>(r);
    const auto* squared = means_squared.ptr<float>(r);
    auto* out = inverse_norm_.ptr<float>(r);
    for (int c = 0; c < placements.width; ++c) {
      const float valid = energy_valid[c][1];
      const float variance = energy_valid[c][0] - squared[c] / std::max(valid, 1.0F);
      // A placement half off the map has little energy: scale it to the whole area, so that it is not favoured.
      out[c] = valid < needed || variance < 1e-6F * area ? 0.0F : std::sqrt(valid / area) / std::sqrt(variance);
    }
  }
}

cv::Mat correlate(const Channels& pattern, const WindowSpectra& window, const TemplateNorm& norm) {
  CV_Assert(pattern.mask.size() == norm.template_size_ && pattern.pairs.size() == window.pairs_.size());
  const cv::Size placements = placements_of(window.window_size_, pattern.mask.size());
  cv::Mat sum = cv::Mat::zeros(window.fft_size_, CV_32FC2);
  double energy = 0;
  for (std::size_t i = 0; i < pattern.pairs.size(); ++i) {
    const cv::Mat levelled = centred(pattern.pairs[i], pattern.mask, window.means_removed_);
    energy += levelled.dot(levelled);
    sum += product_with_conjugate(window.pairs_[i], spectrum_of(levelled, window.fft_size_));
  }
  const cv::Mat product = inverse(sum, placements);
  const auto inverse_template_norm = static_cast<float>(energy > 1e-9 ? 1.0 / std::sqrt(energy) : 0.0);
  cv::Mat scores(placements, CV_32FC1);
  for (int r = 0; r < placements.height; ++r) {
    const auto* from = product.ptr<cv::Vec2f>(r);
    const auto* factor = norm.inverse_norm_.ptr<float>(r);
    auto* to = scores.ptr<float>(r);
    for (int c = 0; c < placements.width; ++c) {
      to[c] = factor[c] > 0 ? from[c][0] * factor[c] * inverse_template_norm : -1.0F;
    }
  }
  return scores;
}

Peak best_peak(const cv::Mat& scores) {
  cv::Point at;
  cv::minMaxLoc(scores, nullptr, nullptr, nullptr, &at);
  return refined_peak(scores, at);
}

std::vector<Peak> distinct_peaks(const cv::Mat& scores, std::size_t count, double min_distance_px) {
  std::vector<Peak> peaks;
  cv::Mat left = scores.clone();
  while (peaks.size() < count) {
    double score = 0;
    cv::Point at;
    cv::minMaxLoc(left, nullptr, &score, nullptr, &at);
    if (score <= 0) break;
    peaks.push_back(refined_peak(scores, at));
    cv::circle(left, at, static_cast<int>(std::ceil(min_distance_px)), cv::Scalar(-1), cv::FILLED);
  }
  return peaks;
}

}  // namespace nadir
