#include "ortho/eligibility.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

// Clouds and fog from above: brighter than dry fields, without colour and without texture.
constexpr int kCloudBrightness = 205, kCloudColour = 18;
constexpr double kCloudTexture = 6;  // gradient, grey levels a pixel

}  // namespace

std::string_view name_of(OrthoRefusal refusal) {
  switch (refusal) {
    case OrthoRefusal::not_anchored: return "not_anchored";
    case OrthoRefusal::unconfirmed: return "unconfirmed";
    case OrthoRefusal::unsure: return "unsure";
    case OrthoRefusal::too_coarse: return "too_coarse";
    case OrthoRefusal::frame_unfit: return "frame_unfit";
    case OrthoRefusal::oblique: return "oblique";
    case OrthoRefusal::steep: return "steep";
    case OrthoRefusal::low_contrast: return "low_contrast";
    case OrthoRefusal::clipped: return "clipped";
    case OrthoRefusal::clouded: return "clouded";
    case OrthoRefusal::apart: return "apart";
    case OrthoRefusal::late: return "late";
    case OrthoRefusal::blurred: return "blurred";
  }
  return "frame_unfit";
}

FrameEligibility check_pose_eligible(const FramePose& pose, double frame_gsd_m, double tile_gsd_m,
                                     const EligibilityLimits& limits) {
  if (pose.source != SourceLabel::satellite_anchored ||
      !(pose.anchor_age_s >= 0 && pose.anchor_age_s <= limits.max_anchor_age_s)) {
    return {OrthoRefusal::not_anchored};
  }
  if (!pose.confirmed) return {OrthoRefusal::unconfirmed};
  if (!(pose.sigma_m > 0 && pose.sigma_m <= limits.soft_sigma_m)) return {OrthoRefusal::unsure};
  if (!(frame_gsd_m > 0 && frame_gsd_m <= limits.max_coarseness * tile_gsd_m)) return {OrthoRefusal::too_coarse};
  return {std::nullopt, pose.sigma_m <= limits.candidate_sigma_m ? CandidateTrust::candidate : CandidateTrust::soft};
}

std::optional<OrthoRefusal> check_image_eligible(const FrameQuality& quality, const EligibilityLimits& limits) {
  const bool fit =
      quality.usable && quality.sharpness >= limits.min_sharpness && quality.contrast >= limits.min_frame_contrast;
  return fit ? std::nullopt : std::optional(OrthoRefusal::frame_unfit);
}

std::optional<OrthoRefusal> check_blur_eligible(std::optional<double> blur_px, double tile_px,
                                                const EligibilityLimits& limits) {
  const double most_px = std::max(limits.max_blur_px, limits.max_tile_blur_px * tile_px);
  return blur_px && !(*blur_px <= most_px) ? std::optional(OrthoRefusal::blurred) : std::nullopt;
}

std::optional<OrthoRefusal> check_view_eligible(const TileProjection& projection, const EligibilityLimits& limits) {
  if (!(projection.view_angle_rad <= limits.max_view_angle_rad)) return OrthoRefusal::oblique;
  if (!(projection.slope <= limits.max_slope)) return OrthoRefusal::steep;
  return std::nullopt;
}

TilePixels measure_tile(const cv::Mat& bgr) {
  cv::Mat grey;
  cv::cvtColor(bgr, grey, cv::COLOR_BGR2GRAY);
  cv::Scalar mean, deviation;
  cv::meanStdDev(grey, mean, deviation);
  TilePixels pixels;
  const auto all = static_cast<double>(grey.total());
  pixels.contrast = deviation[0] / 255;
  pixels.clipped_share = (cv::countNonZero(grey <= 2) + cv::countNonZero(grey >= 253)) / all;
  // Clouds at a quarter of the size: suppresses noise, costs nothing.
  cv::Mat small, small_grey, dx, dy;
  cv::resize(bgr, small, cv::Size(), 0.25, 0.25, cv::INTER_AREA);
  cv::cvtColor(small, small_grey, cv::COLOR_BGR2GRAY);
  cv::Sobel(small_grey, dx, CV_32F, 1, 0, 3, 0.125);
  cv::Sobel(small_grey, dy, CV_32F, 0, 1, 3, 0.125);
  int clouded = 0;
  for (int r = 0; r < small.rows; ++r) {
    for (int c = 0; c < small.cols; ++c) {
      const auto& p = small.at<cv::Vec3b>(r, c);
      const int high = std::max({p[0], p[1], p[2]}), low = std::min({p[0], p[1], p[2]});
      const bool smooth = hypotenuse(dx.at<float>(r, c), dy.at<float>(r, c)) < kCloudTexture;
      if (low >= kCloudBrightness && high - low <= kCloudColour && smooth) ++clouded;
    }
  }
  pixels.cloud_share = clouded / static_cast<double>(small.total());
  return pixels;
}

std::optional<OrthoRefusal> check_tile_eligible(const TilePixels& pixels, const EligibilityLimits& limits) {
  if (pixels.clipped_share > limits.max_clipped_share) return OrthoRefusal::clipped;
  if (pixels.cloud_share > limits.max_cloud_share) return OrthoRefusal::clouded;
  if (pixels.contrast < limits.min_contrast) return OrthoRefusal::low_contrast;
  return std::nullopt;
}

}  // namespace nadir
