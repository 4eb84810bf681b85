// A camera that hangs hands out its last picture again and again, bit for bit. No sensor sees the same noise twice, so
// such a picture says nothing of where the aircraft is now.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>

namespace nadir {

class FrozenFrame {
 public:
  // Whether this picture (8 bit, any channels) is the one before, bit for bit. Empty pictures are never.
  bool again(const cv::Mat& picture);

 private:
  std::optional<std::uint64_t> last_;
};

}  // namespace nadir
