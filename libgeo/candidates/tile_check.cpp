#include "candidates/tile_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/error.hpp"
#include "geodesy/hypotenuse.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

constexpr double kDegreesPerE7 = 1e-7;

Refusal refusal(ReasonCode code, std::string detail) { return {.code = code, .detail = std::move(detail)}; }

// Off the vertical, with the camera so many standard deviations nearer than it claims.
double angle_to(const LonLat& corner, const CandidatePose& pose, double sigmas) {
  const LocalFrame frame(
      {static_cast<double>(pose.lon_e7) * kDegreesPerE7, static_cast<double>(pose.lat_e7) * kDegreesPerE7});
  const Enu at = frame.enu_from_geodetic({corner, 0});
  // Beyond the horizon the plane's coordinates come back; what lies below it is far away.
  const double distance_m = hypotenuse(at.east_m, at.north_m, at.up_m);
  const double slack_m = sigmas * static_cast<double>(pose.sigma_mm) / 1000;
  return std::atan2(std::max(0.0, distance_m - slack_m), static_cast<double>(pose.agl_mm) / 1000);
}

std::optional<Refusal> check_time(UtcMillis captured_at, UtcTime announced_at, UtcTime now,
                                  const CandidateRules& rules) {
  const std::int64_t captured_ms = captured_at.unix_ms, now_ms = now.unix_s * 1000;
  if (captured_ms > now_ms + rules.max_clock_error_ms) {
    return refusal(ReasonCode::captured_in_future,
                   fmt::format("captured {} s ahead of the service's clock; at most {}", (captured_ms - now_ms) / 1000,
                               rules.max_clock_error_ms / 1000));
  }
  if (captured_ms > announced_at.unix_s * 1000 + rules.max_clock_error_ms) {
    return refusal(ReasonCode::captured_in_future, "captured after its batch was created");
  }
  if (captured_ms < now_ms - rules.max_age_ms) {
    return refusal(ReasonCode::too_old, fmt::format("captured {} days ago; at most {}",
                                                    (now_ms - captured_ms) / kDay_ms, rules.max_age_ms / kDay_ms));
  }
  return std::nullopt;
}

std::optional<Refusal> check_place(const CandidateSidecar& sidecar, const CandidateRules& rules) {
  if (!sidecar.key.valid() || sidecar.key.z < rules.min_zoom || sidecar.key.z > rules.max_zoom) {
    return refusal(ReasonCode::address_invalid,
                   fmt::format("{}/{}/{}; zooms {} to {} are accepted", sidecar.key.z, sidecar.key.x, sidecar.key.y,
                               rules.min_zoom, rules.max_zoom));
  }
  if (sidecar.source != SourceLabel::satellite_anchored) {
    return refusal(ReasonCode::pose_uncertain, "the frame was not anchored to the map");
  }
  if (sidecar.pose.sigma_mm > rules.max_sigma_mm) {
    return refusal(ReasonCode::pose_uncertain,
                   fmt::format("sigma {} mm; at most {}", sidecar.pose.sigma_mm, rules.max_sigma_mm));
  }
  if (sidecar.anchor_age_ms > rules.max_anchor_age_ms) {
    return refusal(ReasonCode::anchor_too_old, fmt::format("anchored {} ms before the capture; at most {}",
                                                           sidecar.anchor_age_ms, rules.max_anchor_age_ms));
  }
  if (const double angle = view_angle_rad(sidecar, rules.sigmas); !(angle <= rules.max_view_angle_rad)) {
    return refusal(
        ReasonCode::outside_footprint,
        fmt::format("from {:.0f} m above ground, its worst corner lies {:.0f} degrees off the vertical; at most {:.0f}",
                    static_cast<double>(sidecar.pose.agl_mm) / 1000, angle * 180 / M_PI,
                    rules.max_view_angle_rad * 180 / M_PI));
  }
  return std::nullopt;
}

std::optional<Refusal> check_quality(const CandidateQuality& quality, const CandidateRules& rules) {
  constexpr std::int64_t kAll_ppm = 1'000'000;
  if (quality.overlap_ppm < kAll_ppm) {
    return refusal(ReasonCode::policy, "the frame shows only part of the tile; only complete tiles are accepted");
  }
  if (quality.contrast_ppm < rules.min_contrast_ppm || quality.clipped_ppm > rules.max_clipped_ppm) {
    return refusal(
        ReasonCode::low_texture,
        fmt::format("by its own sidecar: contrast {} ppm, at least {}; {} ppm black or blown out, at most {}",
                    quality.contrast_ppm, rules.min_contrast_ppm, quality.clipped_ppm, rules.max_clipped_ppm));
  }
  return std::nullopt;
}

}  // namespace

// Of the tile's worst corner, each seen from the camera closest to its vertical: the sidecar does not state which frame
// shows which part of a tile, but every corner is shown by one of them.
double view_angle_rad(const CandidateSidecar& sidecar, double sigmas) {
  const LonLatBox box = bounds_of(sidecar.key);
  double worst_rad = 0;
  for (const double lon : {box.west_deg, box.east_deg}) {
    for (const double lat : {box.south_deg, box.north_deg}) {
      double least_rad = M_PI;
      if (sidecar.parts.empty()) least_rad = angle_to({lon, lat}, sidecar.pose, sigmas);
      for (const CandidatePart& part : sidecar.parts) {
        least_rad = std::min(least_rad, angle_to({lon, lat}, part.pose, sigmas));
      }
      worst_rad = std::max(worst_rad, least_rad);
    }
  }
  return worst_rad;
}

std::optional<Refusal> check_announced(const CandidateSidecar& sidecar, UtcTime announced_at, UtcTime now,
                                       const CandidateRules& rules) {
  if (sidecar.size < rules.min_tile_bytes || sidecar.size > rules.max_tile_bytes) {
    return refusal(ReasonCode::size_out_of_range, fmt::format("{} bytes; {} to {} are accepted", sidecar.size,
                                                              rules.min_tile_bytes, rules.max_tile_bytes));
  }
  if (sidecar.format != ImageFormat::jpeg && sidecar.format != ImageFormat::webp) {
    return refusal(ReasonCode::format_unsupported, "JPEG and WebP are accepted");
  }
  if (auto wrong = check_place(sidecar, rules)) return wrong;
  if (auto wrong = check_time(sidecar.captured_at, announced_at, now, rules)) return wrong;
  for (const CandidatePart& part : sidecar.parts) {
    if (auto wrong = check_time(part.captured_at, announced_at, now, rules)) return wrong;
  }
  return check_quality(sidecar.quality, rules);
}

namespace {

constexpr double kPpm = 1e6;
constexpr int kBlur_px = 5;

// Mean length of the gradient, from differences of neighbours. Summed by columns: so the processor takes several pixels
// at a time.
double mean_gradient(const cv::Mat& grey) {
  const int columns = grey.cols - 1;
  std::vector<float> sums(static_cast<std::size_t>(columns));
  for (int row = 0; row + 1 < grey.rows; ++row) {
    const std::uint8_t* here = grey.ptr<std::uint8_t>(row);
    const std::uint8_t* below = grey.ptr<std::uint8_t>(row + 1);
    float* sum = sums.data();
    for (int column = 0; column < columns; ++column) {
      const int right = here[column + 1] - here[column], down = below[column] - here[column];
      sum[column] += std::sqrt(static_cast<float>(right * right + down * down));
    }
  }
  return std::accumulate(sums.begin(), sums.end(), 0.0) / (static_cast<double>(grey.rows - 1) * columns);
}

}  // namespace

std::variant<cv::Mat, Refusal> read_candidate_image(ByteView bytes, const CandidateSidecar& sidecar) {
  const auto unsupported = [](std::string detail) {
    return Refusal{.code = ReasonCode::format_unsupported, .detail = std::move(detail)};
  };
  try {
    const ImageInfo info = read_image_info(bytes, "tile");
    if (info.format != sidecar.format) {
      return unsupported(
          fmt::format("the image is {}, its sidecar says {}", name_of(info.format), name_of(sidecar.format)));
    }
    if (info.width != kTileSize || info.height != kTileSize) {
      return unsupported(
          fmt::format("{} x {} pixels; tiles have {} x {}", info.width, info.height, kTileSize, kTileSize));
    }
    const DecodedImage decoded = decode_image(bytes, Colour::grey, "tile");
    if (!decoded.alpha.empty() && cv::countNonZero(decoded.alpha != 255) > 0) {
      return unsupported("partly transparent; only complete tiles are accepted");
    }
    return decoded.image;
  } catch (const Error& error) {
    return unsupported("not a valid image: " + error.text().what);
  }
}

ImageMetrics image_metrics(const cv::Mat& grey) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(grey, mean, deviation);
  const int clipped = cv::countNonZero(grey == 0) + cv::countNonZero(grey == 255);
  cv::Mat blurred;
  cv::blur(grey, blurred, {kBlur_px, kBlur_px});
  const double before = mean_gradient(grey), after = mean_gradient(blurred);
  return {.contrast_ppm = std::lround(deviation[0] / 255 * kPpm),
          .sharpness_ppm = before > 0 ? std::lround(std::max(0.0, 1 - after / before) * kPpm) : 0,
          .clipped_ppm = std::lround(static_cast<double>(clipped) / static_cast<double>(grey.total()) * kPpm)};
}

std::optional<Refusal> check_image_metrics(const ImageMetrics& metrics, const CandidateRules& rules) {
  if (metrics.contrast_ppm < rules.min_contrast_ppm) {
    return Refusal{.code = ReasonCode::low_texture,
                   .detail = fmt::format("contrast {} ppm; at least {}", metrics.contrast_ppm, rules.min_contrast_ppm)};
  }
  if (metrics.clipped_ppm > rules.max_clipped_ppm) {
    return Refusal{.code = ReasonCode::low_texture,
                   .detail = fmt::format("{} ppm of the pixels are black or blown out; at most {}", metrics.clipped_ppm,
                                         rules.max_clipped_ppm)};
  }
  if (metrics.sharpness_ppm < rules.min_sharpness_ppm) {
    return Refusal{
        .code = ReasonCode::blurred,
        .detail = fmt::format("sharpness {} ppm; at least {}", metrics.sharpness_ppm, rules.min_sharpness_ppm)};
  }
  return std::nullopt;
}

}  // namespace nadir
