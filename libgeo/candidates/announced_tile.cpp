#include "candidates/announced_tile.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "geodesy/local_frame.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

constexpr double kDegreesPerE7 = 1e-7;

Refusal refusal(ReasonCode code, std::string detail) { return {.code = code, .detail = std::move(detail)}; }

// Off the vertical, so many standard deviations of the camera's place nearer than it says.
double angle_to(const LonLat& corner, const CandidatePose& pose, double sigmas) {
  const LocalFrame frame(
      {static_cast<double>(pose.lon_e7) * kDegreesPerE7, static_cast<double>(pose.lat_e7) * kDegreesPerE7});
  const Enu at = frame.enu_from_lonlat(corner);
  // Beyond the horizon the plane's coordinates come back; what lies below it is far away.
  const double distance_m = std::hypot(at.east_m, at.north_m, at.up_m);
  const double slack_m = sigmas * static_cast<double>(pose.sigma_mm) / 1000;
  return std::atan2(std::max(0.0, distance_m - slack_m), static_cast<double>(pose.agl_mm) / 1000);
}

std::optional<Refusal> judge_time(UtcMillis captured_at, UtcTime announced_at, UtcTime now,
                                  const CandidateRules& rules) {
  constexpr std::int64_t kDay_ms = std::int64_t{24} * 3600 * 1000;
  const std::int64_t captured_ms = captured_at.unix_ms, now_ms = now.unix_s * 1000;
  if (captured_ms > now_ms + rules.max_clock_error_ms) {
    return refusal(ReasonCode::captured_in_future,
                   fmt::format("captured {} s ahead of this clock", (captured_ms - now_ms) / 1000));
  }
  if (captured_ms > announced_at.unix_s * 1000 + rules.max_clock_error_ms) {
    return refusal(ReasonCode::captured_in_future, "captured after its batch was made");
  }
  if (captured_ms < now_ms - rules.max_age_ms) {
    return refusal(ReasonCode::too_old, fmt::format("captured {} days ago; at most {}",
                                                    (now_ms - captured_ms) / kDay_ms, rules.max_age_ms / kDay_ms));
  }
  return std::nullopt;
}

std::optional<Refusal> judge_place(const CandidateSidecar& sidecar, const CandidateRules& rules) {
  if (!sidecar.key.valid() || sidecar.key.z < rules.min_zoom || sidecar.key.z > rules.max_zoom) {
    return refusal(ReasonCode::address_invalid,
                   fmt::format("{}/{}/{}; zooms {} to {} are taken", sidecar.key.z, sidecar.key.x, sidecar.key.y,
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
    return refusal(ReasonCode::anchor_too_old,
                   fmt::format("anchored {} ms before; at most {}", sidecar.anchor_age_ms, rules.max_anchor_age_ms));
  }
  if (const double angle = view_angle_rad(sidecar, rules.sigmas); !(angle <= rules.max_view_angle_rad)) {
    return refusal(ReasonCode::outside_footprint,
                   fmt::format("seen from {:.0f} m above its worst corner lies {:.0f} degrees off the vertical",
                               static_cast<double>(sidecar.pose.agl_mm) / 1000, angle * 180 / M_PI));
  }
  return std::nullopt;
}

std::optional<Refusal> judge_quality(const CandidateQuality& quality, const CandidateRules& rules) {
  constexpr std::int64_t kAll_ppm = 1'000'000;
  if (quality.overlap_ppm < kAll_ppm) {
    return refusal(ReasonCode::policy, "the frame saw a part of the tile only; whole tiles are taken");
  }
  if (quality.contrast_ppm < rules.min_contrast_ppm || quality.clipped_ppm > rules.max_clipped_ppm) {
    return refusal(ReasonCode::low_texture, "its own figures say so");
  }
  return std::nullopt;
}

}  // namespace

// Of the tile's worst corner, each seen from the camera that had it most under itself: which part of a tile a frame
// made is not said, but the corners are somebody's.
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

std::optional<Refusal> judge_announced(const CandidateSidecar& sidecar, UtcTime announced_at, UtcTime now,
                                       const CandidateRules& rules) {
  if (sidecar.size < rules.min_tile_bytes || sidecar.size > rules.max_tile_bytes) {
    return refusal(ReasonCode::size_out_of_range, fmt::format("{} bytes; {} to {} are taken", sidecar.size,
                                                              rules.min_tile_bytes, rules.max_tile_bytes));
  }
  if (sidecar.format != ImageFormat::jpeg && sidecar.format != ImageFormat::webp) {
    return refusal(ReasonCode::format_unsupported, "JPEG and WebP are taken");
  }
  if (auto wrong = judge_place(sidecar, rules)) return wrong;
  if (auto wrong = judge_time(sidecar.captured_at, announced_at, now, rules)) return wrong;
  for (const CandidatePart& part : sidecar.parts) {
    if (auto wrong = judge_time(part.captured_at, announced_at, now, rules)) return wrong;
  }
  return judge_quality(sidecar.quality, rules);
}

}  // namespace nadir
