// Which frames, and which of their tiles, may become candidates. A map is poisoned by one tile in the wrong place, and
// loses nothing by one that is not made: whatever is doubtful is left out.
#pragma once

#include <optional>
#include <string_view>

#include "estimation/estimate.hpp"
#include "ortho/candidate_sidecar.hpp"
#include "ortho/tile_projection.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {

struct EligibilityLimits {
  double candidate_sigma_m = 3;  // of the frame's place, one axis
  double soft_sigma_m = 5;
  double max_anchor_age_s = 0.5;
  double max_coarseness = 2;      // the frame's pixels on the ground against the tile's
  double min_sharpness = 0.02;    // of the frame, as FrameQuality has it
  double max_blur_px = 1.8;       // of the picture that tiles are cut from (picture_blur.hpp); a little finer than they
  double max_tile_blur_px = 1.5;  // and this is allowed in any case, in the tile's pixels
  double max_view_angle_rad = 0.6;  // 34 degrees off nadir: what stands up hides little behind it
  double max_slope = 0.25;          // flat or moderate terrain
  double min_contrast = 0.012;      // standard deviation of a tile's grey levels, of 1
  double max_clipped_share = 0.05;  // of a tile's pixels
  double max_cloud_share = 0.25;    // bright, colourless and smooth
};

// Why no tile was made: of a frame, or of one place in it.
enum class OrthoRefusal {
  not_anchored,  // the map has not confirmed this very frame, or too long ago
  unconfirmed,   // by one anchor alone
  unsure,        // sigma beyond what even soft tiles may have
  too_coarse,    // the frame's pixels are much larger than the tile's
  frame_unfit,   // dark, blown out, without detail, of another size, undecodable
  oblique,       // seen too far off nadir
  steep,         // terrain
  low_contrast,
  clipped,
  clouded,
  apart,   // several frames show it, and not in the same place
  late,    // the frame's time was spent
  blurred  // out of focus or moved
};
inline constexpr int kOrthoRefusals = 13;
std::string_view name_of(OrthoRefusal refusal);

struct FrameJudgement {
  std::optional<OrthoRefusal> refusal;
  CandidateTrust trust = CandidateTrust::candidate;  // when there is none
};

// Before anything is decoded. gsd_m: of the frame and of the tiles.
FrameJudgement judge_pose(const FramePose& pose, double frame_gsd_m, double tile_gsd_m,
                          const EligibilityLimits& limits);

// What can be told of the picture: grey is CV_8UC1.
std::optional<OrthoRefusal> judge_picture(const FrameQuality& quality, const EligibilityLimits& limits);

// blur_px: what blur_of() says of the picture that tiles are cut from; nothing where there are not enough edges to
// tell, and then it is no reason: fields under snow show few. tile_px: a pixel of the tile in pixels of that picture.
std::optional<OrthoRefusal> judge_blur(std::optional<double> blur_px, double tile_px, const EligibilityLimits& limits);

std::optional<OrthoRefusal> judge_view(const TileProjection& projection, const EligibilityLimits& limits);

struct TilePixels {
  double contrast = 0;       // standard deviation of grey, of 1
  double clipped_share = 0;  // 0-2 or 253-255
  double cloud_share = 0;
};
TilePixels measure_tile(const cv::Mat& bgr);  // CV_8UC3, 256 x 256
std::optional<OrthoRefusal> judge_tile(const TilePixels& pixels, const EligibilityLimits& limits);

}  // namespace nadir
