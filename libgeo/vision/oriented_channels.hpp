// Oriented-gradient channels (OGC): an image representation that is robust to season, sensor, lighting and contrast.
//
// The gradient's strength is distributed over orientations modulo 180 degrees, so that a bright-to-dark edge and its
// reversal are the same; smoothed in space and over orientation; divided by the local strength plus a floor, so that a
// weak hedge counts as much as a white roof:
//   channel_k = G_σ * [ |g| / (G_pool * |g| + floor · mean |g|) · max(0, cos 2(θ - θ_k))² ],   θ_k = k · 30 degrees,
// with g the gradient of the smoothed image and G a Gaussian. After orientation correlation (Fitch 2002), normalised
// gradient correlation (Tzimiropoulos 2010) and integral channel features (Dollar 2009).
//
// Channels come in pairs, packed as complex images (CV_32FC2): one complex product then correlates two channels.
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "vision/localizer_parameters.hpp"

namespace nadir {

enum class ChannelSet {
  double_angle,      // one pair: (cos, sin) of twice the orientation, for wide sweeps
  six_orientations,  // three pairs: orientations 30 degrees apart, for confirmation and refinement
  // For comparison only (./run bench ablations); the second channel of the pair is empty.
  strength,  // the normalised strength, whatever its orientation
  grey,      // the image itself
};

struct ChannelOptions {
  double sigma_px = kChannelSigma_px;     // smoothing in space
  double floor_fraction = kChannelFloor;  // of the image's mean gradient strength
  double pool_px = kChannelPool_px;       // sigma over which the strength is normalised
  bool means_removed = true;              // each channel's, when it is correlated; see correlation.hpp
};

// What the stages of matching compare.
struct MatchFeatures {
  ChannelSet sweep = ChannelSet::double_angle;
  ChannelSet fine = ChannelSet::six_orientations;  // confirmation and patches
  ChannelOptions channels;
};

struct Channels {
  std::vector<cv::Mat> pairs;  // CV_32FC2 each
  cv::Mat mask;                // CV_8UC1: 255 where the values may be used (the input's mask, eroded)
  bool means_removed = true;
};

// Derivatives per pixel in x and y (CV_32FC1): Sobel's 3 x 3 operator, whose weights sum to 8. image: one channel.
struct ImageGradient {
  cv::Mat x, y;
};
ImageGradient image_gradient(const cv::Mat& image);

// The gradient and the smoothing reach over the border of the valid area: the mask without that margin. mask: CV_8UC1
// or empty (everything valid).
cv::Mat usable_part(const cv::Mat& mask, cv::Size size, const ChannelOptions& options);

// grey: CV_8UC1. mask: CV_8UC1 or empty (everything valid).
Channels oriented_channels(const cv::Mat& grey, const cv::Mat& mask, ChannelSet set,
                           const ChannelOptions& options = {});

}  // namespace nadir
