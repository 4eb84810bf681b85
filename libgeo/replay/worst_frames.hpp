// Keeps the pictures of the frames that a reader of the report wants to see: the worst ones. Bounded memory, however
// long the flight.
#pragma once

#include <string>
#include <vector>

#include "estimation/estimate.hpp"

namespace nadir {

struct FramePictures {
  std::size_t index = 0;
  double badness = 0;
  std::string frame_uri;  // data URIs, JPEG
  std::string map_uri;
};

class WorstFrames {
 public:
  explicit WorstFrames(std::size_t capacity) : capacity_(capacity) {}

  // Frames without both pictures are passed over. badness: see badness_of().
  void offer(std::size_t index, double badness, const AnchorReport& anchor);

  const std::vector<FramePictures>& worst_first() const { return kept_; }

 private:
  std::size_t capacity_;
  std::vector<FramePictures> kept_;  // worst first
};

// The error where it is known. Without truth: how near the match came to being refused, refused ones first.
double badness_of(const FrameReport& report, std::optional<double> error_m);

}  // namespace nadir
