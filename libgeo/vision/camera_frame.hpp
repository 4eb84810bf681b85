// A frame as the camera delivers it: decoded to grey, and checked for whether it can be matched at all. Black,
// overexposed, textureless, blurred and repeated frames must not reach the matcher.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "base/bytes.hpp"
#include "imagery/codecs.hpp"
#include "vision/camera.hpp"

namespace nadir {

// By how much frames of this camera may be decoded smaller without loss for the localizer, which looks at some 500
// pixels across: a large JPEG costs a fraction then. 1, 2, 4 or 8; 1 where halves would not be whole.
int decode_reduction(int width, int height);

// CV_8UC1 of the frame's size divided by `reduction`; empty when the frame is damaged, not of the camera's size, or
// costs more than the budget: the localizer then reports it as unfit. The size is compared before a pixel is decoded.
// camera: scaled by the reduction.
cv::Mat decode_camera_frame(ByteView encoded, const CameraModel& camera, int reduction,
                            const DecodeBudget& budget = {});

struct FrameQuality {
  double mean = 0;           // grey level, 0-255
  double contrast = 0;       // standard deviation of the grey levels at a width of 80 pixels: hardly the sensor's noise
  double clipped_share = 0;  // pixels at 0-2 or 253-255
  double sharpness = 0;      // mean gradient over the standard deviation of the grey levels, at a width of 320 pixels
  bool usable = false;
};

struct QualityLimits {
  double min_contrast = kMinContrast;
  double max_clipped_share = kMaxClippedShare;
  double min_sharpness = kMinSharpness;
};

FrameQuality measure_frame_quality(const cv::Mat& grey, const QualityLimits& limits = {});

// A camera that hangs delivers its last frame again and again, bit for bit. No sensor measures the same noise twice, so
// such a frame has no information about the current position.
class FrozenFrameDetector {
 public:
  // Whether this frame (8 bit, any channels) equals the one before, bit for bit. Empty frames never do.
  bool repeats(const cv::Mat& frame);

 private:
  std::optional<std::uint64_t> last_;
};

// All that decides whether a frame is localized at all, before odometry and matching look at it.
struct FrameCheck {
  bool sharp = false;     // FrameQuality::usable
  bool repeated = false;  // sharp, but the same image as the last sharp one

  bool usable() const { return sharp && !repeated; }
};

// Checks the frames of one flight, in order. Behind an interface, as odometry and matcher are, so that a flight can be
// estimated again from what was found in its frames, without them (flights/recorded_vision.hpp).
class FrameChecker {
 public:
  virtual ~FrameChecker() = default;
  virtual FrameCheck check(const cv::Mat& grey) = 0;
};

using FrameCheckerFactory = std::function<std::unique_ptr<FrameChecker>()>;

// measure_frame_quality() and, of a sharp frame, a FrozenFrameDetector.
std::unique_ptr<FrameChecker> make_frame_checker();

}  // namespace nadir
