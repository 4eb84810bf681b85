// SIFT (Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004): points of an image that are
// found again when it is turned and scaled, and what their surroundings look like.
//
// The image is doubled and blurred step by step to scales σ_k = kSiftSigma_px · 2^(k / layers); after each doubling of
// σ every second pixel is left out (an octave). Points are the extrema in place and scale of differences of
// neighbouring scales, refined by a quadratic through their 26 neighbours; those of little contrast and those along
// edges are rejected. Each is given the direction of its gradients, and described by 4 x 4 histograms of the gradients
// around it, turned to that direction: 128 numbers.
//
// The order of the steps is what makes it quick. Differences of scales are never stored: their extrema are found row by
// row. The strongest points are selected before directions are looked for, because contrast does not depend on them.
// Gradients of a window are computed eight at a time, then each is added to the four histograms around it, by a table
// of how its angle divides among the eight directions. Each result comes from one lane: whatever the width of the
// registers, the bits are the same.
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <vector>

#include "vision/feature_matching.hpp"

namespace nadir {

struct SiftOptions {
  int max_features = 0;     // the strongest ones; as many more as the last of these has directions
  int octave_layers = 0;    // scales per octave in which points are found
  double min_contrast = 0;  // of an extremum, times octave_layers, as a share of white
};

struct SiftFeatures {
  std::vector<cv::Point2f> points;  // pixels of the image
  FeatureDescriptors descriptors;   // of the same features; their order: strongest first
};

// grey: CV_8UC1 of any size. None when it is too small or shows nothing.
SiftFeatures sift_features(const cv::Mat& grey, const SiftOptions& options);

}  // namespace nadir
