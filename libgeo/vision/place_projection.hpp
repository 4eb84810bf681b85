// Principal components of place descriptors: 384 numbers become 128 that say nearly as much. Trained on the ground that
// is indexed, stored with the index.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "vision/place_descriptor.hpp"

namespace nadir {

inline constexpr std::size_t kPlaceSize = 128;

using PlaceVector = std::array<float, kPlaceSize>;  // of length 1: inner products are cosines

struct PlaceProjection {
  std::vector<float> mean;   // kRawPlaceSize
  std::vector<float> basis;  // kPlaceSize rows of kRawPlaceSize, the strongest component first
  double kept = 0;           // share of the variance

  PlaceVector project(const RawPlaceDescriptor& descriptor) const;
};

// The same samples give the same projection: each component's largest coefficient is positive.
PlaceProjection train_projection(std::span<const RawPlaceDescriptor> samples);

}  // namespace nadir
