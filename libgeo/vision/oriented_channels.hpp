// Oriented-gradient channels (OGC): what of a picture survives another season, sensor, sun and contrast.
//
// The gradient's strength is spread over orientations modulo 180 degrees, so that a bright-to-dark edge and its
// reversal are the same; smoothed in space and over orientation; divided by the local strength plus a floor, so that a
// weak hedge counts as much as a white roof. After orientation correlation (Fitch 2002), normalised gradient
// correlation (Tzimiropoulos 2010) and integral channel features (Dollar 2009).
//
// Channels come in pairs, packed as complex images (CV_32FC2): one complex product then correlates two channels.
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

namespace nadir {

enum class ChannelSet {
  double_angle,      // one pair: (cos, sin) of twice the orientation, for wide sweeps
  six_orientations,  // three pairs: orientations 30 degrees apart, for confirmation and refinement
  // Poorer ones, of which the second of the pair is empty. Nothing flies with them: they show what the others are worth
  // (./run bench ablations).
  strength,  // the levelled strength, whatever its orientation
  grey,      // the picture itself
};

struct ChannelOptions {
  double sigma_px = 1.0;         // smoothing in space
  double floor_fraction = 0.35;  // of the picture's mean gradient strength
  double pool_px = 2.0;          // radius over which the strength is levelled
  bool means_removed = true;     // each channel's, when it is correlated; see correlation.hpp
};

// What the steps of a search compare.
struct Likeness {
  ChannelSet sweep = ChannelSet::double_angle;
  ChannelSet fine = ChannelSet::six_orientations;  // confirmation and patches
  ChannelOptions channels;
};

struct Channels {
  std::vector<cv::Mat> pairs;  // CV_32FC2 each
  cv::Mat mask;                // CV_8UC1: 255 where the values may be used (the input's mask, eroded)
  bool means_removed = true;
};

// grey: CV_8UC1. mask: CV_8UC1 or empty (everything valid).
Channels oriented_channels(const cv::Mat& grey, const cv::Mat& mask, ChannelSet set,
                           const ChannelOptions& options = {});

}  // namespace nadir
