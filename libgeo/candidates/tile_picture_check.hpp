// What a candidate's picture is worth, by the service's own eyes: the figures in the sidecar are its maker's.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <variant>

#include "candidates/candidate_rules.hpp"
#include "candidates/catalogue_rows.hpp"

namespace nadir {

// The picture's grey levels: CV_8UC1, kTileSize square. The header is looked at first: nothing is decoded that has
// other dimensions or another format than the sidecar names.
std::variant<cv::Mat, Refusal> read_candidate_picture(ByteView bytes, const CandidateSidecar& sidecar);

// A sharp picture loses much of its gradients when it is blurred a little, a blurred one hardly any (Crete et al. 2007,
// "The blur effect"): that says more than gradients alone, which the ground decides.
struct PictureFigures {
  std::int64_t contrast_ppm = 0;   // standard deviation of the grey levels, of 255
  std::int64_t sharpness_ppm = 0;  // share of the mean gradient that is lost by averaging over 5 × 5 pixels
  std::int64_t clipped_ppm = 0;    // of the pixels: 0 or 255
};
PictureFigures picture_figures(const cv::Mat& grey);

std::optional<Refusal> judge_figures(const PictureFigures& figures, const CandidateRules& rules);

}  // namespace nadir
