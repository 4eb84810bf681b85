#include "ortho/candidate_maker.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/frame_image.hpp"
#include "ortho/candidate_sidecar.hpp"
#include "ortho/image_blur.hpp"
#include "vision/rolling_shutter.hpp"

namespace nadir {
namespace {

std::int64_t whole_units(double value, double unit) { return std::llround(value / unit); }
std::int64_t ppm(double share) { return std::clamp<std::int64_t>(whole_units(share, 1e-6), 0, 1'000'000); }
std::int64_t mdeg(double rad) { return whole_units(degrees(rad), 1e-3); }

constexpr std::int64_t kFullTurn_mdeg = 360'000;

// The image in colour, decoded no larger than needed; empty when it is damaged or has another size.
cv::Mat decoded(ByteView encoded, const CameraModel& camera, int shrink, const std::string& name) {
  try {
    cv::Mat image = decode_frame(encoded, Colour::bgr, name, shrink);
    if (image.cols == camera.width / shrink && image.rows == camera.height / shrink) return image;
  } catch (const Error&) {
    // Frames are damaged in transit now and then; this one makes no tiles.
  }
  return {};
}

MosaicLimits mosaic_limits(const CandidateFlight& flight) {
  MosaicLimits limits = flight.mosaic;
  limits.candidate_sigma_m = flight.limits.candidate_sigma_m;
  limits.soft_sigma_m = flight.limits.soft_sigma_m;
  return limits;
}

void count(OrthoRefusal refusal, FrameTiles& report) { ++report.refused[static_cast<std::size_t>(refusal)]; }

}  // namespace

CandidateMaker::CandidateMaker(const CandidateFlight& flight)
    : flight_(flight),
      seen_with_(flight.lens ? flight.lens->applied_to(flight.camera) : flight.camera),
      camera_(camera_digest(flight.camera)),
      mosaics_(mosaic_limits(flight)) {
  if (flight.zoom < 0 || flight.zoom > kMaxZoom) {
    throw UsageError({.what = "no such zoom", .expected = "0 to 24", .found = std::to_string(flight.zoom)});
  }
  // A name that no sidecar can hold is refused before the flight, not with its first tile.
  CandidateSidecar probe = sidecar_of({"frame", {}, {}}, CandidateTrust::candidate);
  probe.size = 1;
  probe.gsd_mm = probe.pose.agl_mm = probe.pose.sigma_mm = 1;
  try {
    static_cast<void>(candidate_json(probe));
  } catch (const Error& error) {
    throw UsageError({.what = "cannot make candidate tiles with these names",
                      .where = error.text().where,
                      .expected = error.text().expected,
                      .found = error.text().found});
  }
}

CandidateSidecar CandidateMaker::sidecar_of(const PosedFrame& seen, CandidateTrust trust) const {
  CandidateSidecar sidecar;
  sidecar.airframe = flight_.airframe;
  sidecar.flight = flight_.flight;
  sidecar.base_package = flight_.base_package;
  sidecar.frame = frame_label(seen.name);
  sidecar.format = flight_.format;
  sidecar.captured_at = seen.captured_at;
  sidecar.source = seen.pose.source;
  sidecar.anchor_age_ms = whole_units(seen.pose.anchor_age_s, 1e-3);
  sidecar.trust = trust;
  sidecar.camera = camera_;
  const CameraPose& pose = seen.pose.pose;
  const LonLat place = flight_.frame.lonlat_from_plane(pose.position);
  sidecar.gsd_mm = whole_units(gsd_at(seen_with_, pose.agl_m), 1e-3);
  sidecar.pose = {.lat_e7 = whole_units(place.lat_deg, 1e-7),
                  .lon_e7 = whole_units(place.lon_deg, 1e-7),
                  .agl_mm = whole_units(pose.agl_m, 1e-3),
                  .heading_mdeg = (mdeg(pose.attitude.heading_rad) % kFullTurn_mdeg + kFullTurn_mdeg) % kFullTurn_mdeg,
                  .pitch_mdeg = mdeg(pose.attitude.pitch_rad),
                  .roll_mdeg = mdeg(pose.attitude.roll_rad),
                  .sigma_mm = whole_units(seen.pose.sigma_m, 1e-3),
                  .cov_ee_mm2 = whole_units(seen.pose.covariance_m2(0, 0), 1e-6),
                  .cov_en_mm2 = whole_units(seen.pose.covariance_m2(0, 1), 1e-6),
                  .cov_nn_mm2 = whole_units(seen.pose.covariance_m2(1, 1), 1e-6),
                  .refined = seen.pose.refined};
  return sidecar;
}

std::optional<CandidateMaker::PreparedFrame> CandidateMaker::prepare(const PosedFrame& seen, ByteView encoded,
                                                                     FrameTiles& report) const {
  const CameraPose& pose = seen.pose.pose;
  const LonLat place = flight_.frame.lonlat_from_plane(pose.position);
  const double tile_gsd_m = ground_resolution_m(flight_.zoom, place.lat_deg);
  const double frame_gsd_m = gsd_at(seen_with_, pose.agl_m);
  const FrameEligibility eligibility = check_pose_eligible(seen.pose, frame_gsd_m, tile_gsd_m, flight_.limits);
  report.refusal = eligibility.refusal;
  if (report.refusal) return std::nullopt;
  const int shrink = decoding_shrink(seen_with_, pose.agl_m, tile_gsd_m);
  cv::Mat picture = decoded(encoded, flight_.camera, shrink, seen.name);
  report.refusal = OrthoRefusal::frame_unfit;
  if (picture.empty()) return std::nullopt;
  cv::Mat grey;
  cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
  const FrameQuality quality = measure_frame_quality(grey);
  report.refusal = check_image_eligible(quality, flight_.limits);
  if (report.refusal) return std::nullopt;
  if (flight_.readout) {
    const CameraMotion& motion = seen.pose.motion;
    picture = without_rolling_shutter(picture, seen_with_.scaled(1.0 / shrink), *flight_.readout,
                                      {pose.attitude, pose.agl_m, motion.velocity_mps, motion.rate_rad_s});
  }
  PreparedFrame frame{reduce_frame(picture, seen_with_.scaled(1.0 / shrink), pose.agl_m, tile_gsd_m),
                      sidecar_of(seen, eligibility.trust), tile_gsd_m};
  cv::cvtColor(frame.reduced.image, grey, cv::COLOR_BGR2GRAY);
  report.refusal =
      check_blur_eligible(blur_of(grey), tile_gsd_m / gsd_at(frame.reduced.camera, pose.agl_m), flight_.limits);
  if (report.refusal) return std::nullopt;
  seen.correction.apply(frame.reduced.image, frame.reduced.camera);
  frame.sidecar.quality.sharpness_ppm = ppm(quality.sharpness);
  frame.sidecar.quality.overlap_ppm = ppm(1);
  return frame;
}

std::vector<CandidateMaker::RawTile> CandidateMaker::make_whole_tiles(const PosedFrame& seen,
                                                                      const PreparedFrame& frame,
                                                                      FrameTiles& report) const {
  std::vector<ProjectedTile> wanted =
      whole_tiles(flight_.zoom, flight_.frame, frame.reduced.camera, seen.pose.pose, *flight_.surface);
  report.whole = wanted.size();
  std::erase_if(wanted, [&](const ProjectedTile& tile) {
    const auto refusal = check_view_eligible(tile.projection, flight_.limits);
    if (refusal) count(*refusal, report);
    return refusal.has_value();
  });
  const std::vector<OrthoTile> made = orthorectify(frame.reduced, wanted);
  std::vector<RawTile> tiles;
  for (std::size_t i = 0; i < made.size(); ++i) {
    const TilePixels pixels = measure_tile(made[i].image);
    if (const auto refusal = check_tile_eligible(pixels, flight_.limits)) {
      count(*refusal, report);
      continue;
    }
    CandidateSidecar& sidecar = tiles.emplace_back(RawTile{frame.sidecar, made[i].image}).sidecar;
    sidecar.key = made[i].key;
    sidecar.quality.contrast_ppm = ppm(pixels.contrast);
    sidecar.quality.clipped_ppm = ppm(pixels.clipped_share);
    sidecar.quality.view_angle_mdeg = mdeg(wanted[i].projection.view_angle_rad);
  }
  return tiles;
}

// Not where the store already has a better tile than the best possible mosaic.
void CandidateMaker::add_partial_tiles(const PosedFrame& seen, const PreparedFrame& frame, CandidateStore& store,
                                       const DeadlinePassed& deadline_passed, FrameTiles& report) {
  std::vector<ProjectedTile> tiles =
      partial_tiles(flight_.zoom, flight_.frame, frame.reduced.camera, seen.pose.pose, *flight_.surface);
  CandidateSidecar best = frame.sidecar;
  std::erase_if(tiles, [&](const ProjectedTile& tile) {
    best.key = tile.key;
    return tile.projection.slope > flight_.limits.max_slope || !store.wants(best);
  });
  for (const ProjectedTile& tile : tiles) {
    if (deadline_passed && deadline_passed()) {
      count(OrthoRefusal::late, report);
      continue;
    }
    const auto partial = cut_partial_tile(frame.reduced, tile, flight_.limits.max_view_angle_rad);
    if (!partial) continue;
    best.key = tile.key;
    best.quality.view_angle_mdeg = mdeg(partial->least_view_rad);
    if (!store.wants(best)) continue;
    ++report.partial_tiles[static_cast<std::size_t>(mosaics_.add(*partial, frame.sidecar, frame.tile_gsd_m))];
  }
}

std::vector<CandidateMaker::RawTile> CandidateMaker::eligible_mosaics(const std::vector<TileMosaic>& mosaics,
                                                                      FrameTiles& report) const {
  std::vector<RawTile> tiles;
  for (const TileMosaic& mosaic : mosaics) {
    auto sidecar = mosaic.sidecar();
    const TilePixels pixels = measure_tile(mosaic.image());
    const auto refusal = sidecar ? check_tile_eligible(pixels, flight_.limits) : OrthoRefusal::apart;
    if (refusal) {
      count(*refusal, report);
      continue;
    }
    sidecar->quality.contrast_ppm = ppm(pixels.contrast);
    sidecar->quality.clipped_ppm = ppm(pixels.clipped_share);
    tiles.push_back({std::move(*sidecar), mosaic.image()});
  }
  return tiles;
}

void CandidateMaker::store_tiles(const std::vector<RawTile>& tiles, CandidateStore& store,
                                 const DeadlinePassed& deadline_passed, FrameTiles& report) const {
  std::vector<Candidate> candidates;
  for (const RawTile& tile : tiles) {
    if (deadline_passed && deadline_passed()) {
      count(OrthoRefusal::late, report);
      continue;
    }
    if (!store.wants(tile.sidecar)) {
      report.stored.emplace_back(tile.sidecar.key, CandidateOutcome::worse);
      continue;
    }
    Candidate& candidate = candidates.emplace_back();
    candidate.tile = encode_image(tile.image, flight_.format, flight_.quality);
    candidate.sidecar = tile.sidecar;
    candidate.sidecar.sha256 = sha256(candidate.tile);
    candidate.sidecar.size = candidate.tile.size();
    candidate.sidecar_bytes = candidate_json(candidate.sidecar);
    candidate.signature = sign_candidate(*flight_.key, candidate.sidecar_bytes);
  }
  if (candidates.empty()) return;
  const auto outcomes = store.put(candidates);
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    report.stored.emplace_back(candidates[i].sidecar.key, outcomes[i]);
    const bool kept = outcomes[i] == CandidateOutcome::added || outcomes[i] == CandidateOutcome::replaced;
    if (kept && !candidates[i].sidecar.parts.empty()) ++report.mosaics_stored;
  }
}

std::vector<CandidateMaker::RawTile> CandidateMaker::raw_tiles(const PosedFrame& seen, ByteView encoded,
                                                               FrameTiles& report) const {
  const auto frame = prepare(seen, encoded, report);
  return frame ? make_whole_tiles(seen, *frame, report) : std::vector<RawTile>();
}

FrameTiles CandidateMaker::make(const PosedFrame& seen, ByteView encoded, CandidateStore& store,
                                const DeadlinePassed& deadline_passed) {
  FrameTiles report;
  const auto frame = prepare(seen, encoded, report);
  if (!frame) return report;
  store_tiles(make_whole_tiles(seen, *frame, report), store, deadline_passed, report);
  if (!flight_.merge_partial_tiles) return report;
  add_partial_tiles(seen, *frame, store, deadline_passed, report);
  store_tiles(eligible_mosaics(mosaics_.take_finished(), report), store, {}, report);  // they would be lost
  return report;
}

FrameTiles CandidateMaker::finish(CandidateStore& store) {
  FrameTiles report;
  store_tiles(eligible_mosaics(mosaics_.take_all_complete(), report), store, {}, report);
  return report;
}

}  // namespace nadir
