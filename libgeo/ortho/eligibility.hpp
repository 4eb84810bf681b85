// Which frames, and which of their tiles, may become candidates. One tile in the wrong place corrupts a map; a tile
// that is not made costs nothing: uncertain ones are left out.
#pragma once

#include <optional>
#include <string_view>

#include "estimation/estimate.hpp"
#include "ortho/candidate_sidecar.hpp"
#include "ortho/orthorectifier.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {

struct EligibilityLimits {
  double candidate_sigma_m = 3;  // 1-sigma position error of the frame per axis
  double soft_sigma_m = 5;
  double max_anchor_age_s = 0.5;
  double max_coarseness = 2;      // ground sample distance of the frame over that of the tile
  double min_sharpness = 0.02;    // of the frame, as FrameQuality has it
  double min_frame_contrast = 5;  // likewise; grey levels
  double max_blur_px =
      1.8;  // of the image that tiles are resampled from (image_blur.hpp), a little finer than the tile
  double max_tile_blur_px = 1.5;    // allowed in any case, in pixels of the tile
  double max_view_angle_rad = 0.6;  // 34 degrees off nadir: little occlusion
  double max_slope = 0.25;          // flat or moderate terrain
  double min_contrast = 0.012;      // standard deviation of a tile's grey levels, of 1
  double max_clipped_share = 0.05;  // of a tile's pixels
  double max_cloud_share = 0.25;    // bright, colourless and smooth
};

// Why no tile was made: of a frame, or of one place in it.
enum class OrthoRefusal {
  not_anchored,  // no map match for this frame, or too long ago
  unconfirmed,   // a single anchor only
  unsure,        // sigma above the limit of soft tiles
  too_coarse,    // the frame's pixels are much larger than the tile's
  frame_unfit,   // dark, overexposed, without detail, of another size, undecodable
  oblique,       // view angle too large
  steep,         // terrain
  low_contrast,
  clipped,
  clouded,
  apart,   // of a mosaic: the parts' positions are too uncertain together
  late,    // the deadline had passed
  blurred  // out of focus or moved
};
inline constexpr int kOrthoRefusals = 13;
std::string_view name_of(OrthoRefusal refusal);

struct FrameEligibility {
  std::optional<OrthoRefusal> refusal;
  CandidateTrust trust = CandidateTrust::candidate;  // without a refusal
};

// Before decoding. Ground sample distances of the frame and of the tiles.
FrameEligibility check_pose_eligible(const FramePose& pose, double frame_gsd_m, double tile_gsd_m,
                                     const EligibilityLimits& limits);

// After decoding.
std::optional<OrthoRefusal> check_image_eligible(const FrameQuality& quality, const EligibilityLimits& limits);

// blur_px: blur_of() the image that tiles are resampled from; nothing where there are too few edges, which is no reason
// for a refusal: fields under snow show few. tile_px: a pixel of the tile in pixels of that image.
std::optional<OrthoRefusal> check_blur_eligible(std::optional<double> blur_px, double tile_px,
                                                const EligibilityLimits& limits);

std::optional<OrthoRefusal> check_view_eligible(const TileProjection& projection, const EligibilityLimits& limits);

struct TilePixels {
  double contrast = 0;       // standard deviation of grey, of 1
  double clipped_share = 0;  // 0-2 or 253-255
  double cloud_share = 0;
};
TilePixels measure_tile(const cv::Mat& bgr);  // CV_8UC3, 256 x 256
std::optional<OrthoRefusal> check_tile_eligible(const TilePixels& pixels, const EligibilityLimits& limits);

}  // namespace nadir
