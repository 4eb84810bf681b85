// Checks of a candidate tile: its sidecar before any byte of its image is received, and the image itself. What two
// images say of each other: image_agreement.hpp.
//
// Signatures are checked first, by the caller: an unsigned sidecar proves nothing.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <variant>

#include "candidates/candidate_rules.hpp"
#include "candidates/catalogue_rows.hpp"

namespace nadir {

// The first reason to reject it, the most useful to an operator first.
// announced_at: the time of creation that its batch states.
std::optional<Refusal> check_announced(const CandidateSidecar& sidecar, UtcTime announced_at, UtcTime now,
                                       const CandidateRules& rules);

// How far a tile's worst corner lies off the vertical below the camera; uncertainty of the pose counts in the
// tile's favour. Flat ground.
double view_angle_rad(const CandidateSidecar& sidecar, double sigmas);

// The image's grey levels: CV_8UC1, kTileSize square. The header is checked first: an image whose dimensions
// or format differ from the sidecar's is not decoded.
std::variant<cv::Mat, Refusal> read_candidate_image(ByteView bytes, const CandidateSidecar& sidecar);

// Measured by the service itself: the figures in the sidecar are the aircraft's. Sharpness is the share of the
// gradients that a slight blur removes: most of them in a sharp image, hardly any in a blurred one (Crete et al. 2007,
// "The blur effect"). The gradients alone depend on the ground.
struct ImageMetrics {
  std::int64_t contrast_ppm = 0;   // standard deviation of the grey levels, of 255
  std::int64_t sharpness_ppm = 0;  // share of the mean gradient that is lost by averaging over 5 × 5 pixels
  std::int64_t clipped_ppm = 0;    // of the pixels: 0 or 255
};
ImageMetrics image_metrics(const cv::Mat& grey);

std::optional<Refusal> check_image_metrics(const ImageMetrics& metrics, const CandidateRules& rules);

}  // namespace nadir
