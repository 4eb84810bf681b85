// What is wrong with a candidate as its sidecar describes it, before any byte of its picture has come.
//
// Signatures are checked first by whoever calls: a sidecar that nobody vouches for says nothing.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <variant>

#include "candidates/candidate_rules.hpp"
#include "candidates/catalogue_rows.hpp"

namespace nadir {

// The first reason for refusing it, in the order in which an operator would want to hear them.
// announced_at: when its batch says that it was made.
std::optional<Refusal> judge_announced(const CandidateSidecar& sidecar, UtcTime announced_at, UtcTime now,
                                       const CandidateRules& rules);

// How far a tile's worst corner lies off the vertical below the camera; the uncertainty of the pose is on the tile's
// side. Flat ground.
double view_angle_rad(const CandidateSidecar& sidecar, double sigmas);

// What a candidate's picture is worth, by the service's own eyes: the figures in the sidecar are its maker's.

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

// Do two pictures of one tile show the same ground, and how far do they lie apart?
//
// The means of both over 25 pixels are taken away: light and season change those more than what is finer. Where the
// phases of the two correlate best is the shift (cv::phaseCorrelate, Foroosh et al. 2002, to a fraction of a pixel);
// whether they agree there says the correlation coefficient of what lies upon each other (-1 to 1).

struct Agreement {
  double shift_px = 0;  // length
  double correlation = 0;
};

// Both CV_8UC1 and of one size. Symmetric but for rounding.
Agreement compare_pictures(const cv::Mat& one, const cv::Mat& other);

}  // namespace nadir
