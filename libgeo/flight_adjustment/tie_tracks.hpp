// From matches of pairs to tie points: features that were matched with each other, directly or through other frames,
// are one point. A point that has two features in one frame was joined by a wrong match somewhere, and is dropped.
//
// Of thousands of points a frame needs few: what determines its pose is that they are spread over the picture, and that
// they last over many frames. So the longest ones are taken first, and a point is taken only where at least two of its
// frames have too few in its part of the picture.
#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <span>
#include <vector>

#include "vision/feature_matching.hpp"

namespace nadir {

// Matched features of two frames.
struct TiePair {
  std::size_t a = 0, b = 0;           // frames
  std::vector<FeatureMatch> matches;  // first: of a, second: of b
};

struct TieObservation {
  std::uint32_t frame = 0, feature = 0;
};
using TieTrack = std::vector<TieObservation>;  // by frame, each at most once

// features: how many each frame has. In the order of the first observations.
std::vector<TieTrack> tie_tracks(std::span<const std::size_t> features, std::span<const TiePair> pairs);

// A well-spread subset. points: of each frame; size: of the pictures.
std::vector<TieTrack> well_spread(std::vector<TieTrack> tracks, std::span<const std::vector<cv::Point2f>> points,
                                  cv::Size size);

}  // namespace nadir
