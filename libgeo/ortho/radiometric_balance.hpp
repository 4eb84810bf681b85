// Frames as if all had been taken with one exposure through a lens that darkens nothing, so that a mosaic of them shows
// no steps where they meet.
//
// A frame f shows ground of radiance R at the place (x, y) from its principal point, (0, 0) to 1 at half of the image's
// diagonal, r² = x² + y², in a channel as the level
//
//   ln level = ln R + e_f + v(r) + b · q,    v(r) = a1 r² + a2 r⁴ + a3 r⁶,    q = (x, y) turned to east and north
//
// e_f: its exposure and white balance; v: the lens' fall-off; b: that ground looks brighter from where the sun stands
// than against it. v and b are shared by all frames. Display values are a power of the light, about, so that all remain
// factors. Of ground that two frames show R cancels:
//
//   minimise  Σ w ((e_f - e_g + v_f - v_g + b · (q_f - q_g)) - ln(level_f / level_g))²  +  Σ (e_f / σ_e)²
//             +  priors of a and b
//
// over all e, a and b, per channel. The level is the mean of a cell of the ground, a twentieth of the first footprint
// across, so that neither noise nor a pixel of displacement counts. w: all cells that two frames share count as one
// measurement, because they err together; each of them by Cauchy's weight, one for all channels: cars, shadows that
// moved, and roofs that lean are outliers.
//
// Overlaps alone do not know a slow change of the level over the flight: a ramp of e over the ground and b are the same
// to them. The prior of e decides for b, and keeps the large scale as the camera saw it: without it a mosaic of frames
// that the sun shines into from one side is black at one end. A frame that shares no ground stays as it is. In the end
// each channel is scaled as a whole so that the mean of ln level stays what it was.
//
// See Goldman, "Vignette and exposure calibration and compensation", PAMI 32 (2010). A frame costs 300 cells of 40
// bytes, and at most two equations of 80 bytes for each: 3000 frames fit into 250 MB.
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <utility>
#include <vector>

#include "vision/rectification.hpp"

namespace nadir {

// What brings the levels of a frame to those of the balanced flight. Channels as OpenCV has them: blue, green, red.
struct RadiometricCorrection {
  std::array<double, 3> log_gain{};                     // of each channel: - e_f
  std::array<std::array<double, 3>, 3> log_falloff{};   // of each channel: a1, a2, a3
  std::array<std::array<double, 2>, 3> log_gradient{};  // of each channel: b to the right and down in the image

  // ln of the factor for the pixel (x, y) of an image of the frame at any reduction; camera: of that image.
  double log_factor(std::size_t channel, const CameraModel& camera, double x, double y) const;
  // bgr: CV_8UC3, such an image.
  void apply(cv::Mat& bgr, const CameraModel& camera) const;

  bool operator==(const RadiometricCorrection&) const = default;
};

class RadiometricBalance {
 public:
  // surface must outlive this.
  explicit RadiometricBalance(const GroundSurface& surface) : surface_(surface) {}

  // In the order of frames; each at most once. bgr: CV_8UC3, some 300 pixels across or more; camera: of that image.
  void add(std::uint32_t frame, const cv::Mat& bgr, const CameraModel& camera, const CameraPose& pose);

  // Of so many frames; those that were never added stay as they are. The same frames give the same bits.
  std::vector<RadiometricCorrection> solve(std::size_t frames) const;

 private:
  struct Sample {  // a cell of the ground in one frame
    std::int32_t east = 0, north = 0;
    std::uint32_t frame = 0;
    float r2 = 0, q_east = 0, q_north = 0;
    std::array<float, 3> log_level{};
  };

  const GroundSurface& surface_;
  double cell_m_ = 0;
  std::vector<Sample> samples_;
  std::vector<std::pair<std::uint32_t, double>> headings_rad_;  // of the frames that were added
};

}  // namespace nadir
