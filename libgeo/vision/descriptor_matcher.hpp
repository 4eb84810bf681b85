// A map matcher that compares what a descriptor network sees (dense_descriptors.hpp), the second witness beside
// oriented channels: it fails for other reasons.
//
// Frame and map are rectified and described at one ground sample distance g. A cell of 8 px is the pixel of what
// follows:
//
//   1. sweep: the frame's cells, turned and scaled for each heading and height within the prediction, are correlated
//      with the map's cells over the whole window by FFT (correlation.hpp), in the map's principal channels.
//      Descriptors bear some turn, so one description serves neighbouring headings.
//   2. confirm: at the best places the same description is correlated directly, on the map's cells, with headings and
//      heights between those of the sweep; the ratio compares them.
//   3. patches: the frame is described anew under the best place's pose; 6 x 6 cells are matched
//      with the map around them, and give the camera's pose (pose_refinement.hpp). Twice.
//
// A position is good to about a quarter of a cell, 1 to 2 m where g is 0.5 m: coarser than oriented channels.
#pragma once

#include <memory>

#include "vision/dense_descriptors.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

struct DescriptorMatching {
  int principal_channels = parameters::learned_matching::kPrincipalChannels;
  double frame_px = parameters::learned_matching::kDescribedFrame_px;  // a frame's longer side
};

// Throws what the network throws.
std::unique_ptr<MapMatcher> make_descriptor_matcher(const MatcherMap& map,
                                                    std::shared_ptr<DenseDescriptorNetwork> network,
                                                    const DescriptorMatching& how = {});

}  // namespace nadir
