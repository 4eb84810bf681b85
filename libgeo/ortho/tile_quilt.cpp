#include "ortho/tile_quilt.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geodesy/angles.hpp"
#include "ortho/candidate_store.hpp"
#include "ortho/seam.hpp"

namespace nadir {
namespace {

constexpr std::uint8_t kNobody = 255;
constexpr int kTile_px = kTileSize * kTileSize;
constexpr int kLeastGain_px = 64;        // for less a piece is not worth another seam
constexpr float kClearlyBetter = 0.98F;  // so that equal pieces do not fray into each other

std::int64_t mm(double metres) { return std::llround(metres * 1000); }

}  // namespace

std::string_view name_of(PieceOutcome fate) {
  switch (fate) {
    case PieceOutcome::joined: return "joined";
    case PieceOutcome::hidden: return "hidden";
    case PieceOutcome::unproven: return "unproven";
    case PieceOutcome::apart: return "apart";
    case PieceOutcome::full: return "full";
  }
  return "full";
}

TileMosaic::TileMosaic(const TileKey& key, double pixel_m, const QuiltLimits& limits)
    : key_(key),
      pixel_m_(pixel_m),
      limits_(limits),
      image_(cv::Mat::zeros(kTileSize, kTileSize, CV_8UC3)),
      slants_(cv::Mat::zeros(kTileSize, kTileSize, CV_32FC1)),
      cost_mm2_(kTileSize, kTileSize, CV_32FC1, cv::Scalar::all(INFINITY)),
      owner_(kTileSize, kTileSize, CV_8UC1, cv::Scalar::all(kNobody)) {}

bool TileMosaic::spans(UtcMillis time) const {
  const auto most_ms = std::llround(limits_.max_span_s * 1000);
  return std::all_of(pieces_.begin(), pieces_.end(), [&](const Piece& piece) {
    return piece.pixels == 0 || std::abs(time.unix_ms - piece.frame.captured_at.unix_ms) <= most_ms;
  });
}

std::size_t TileMosaic::free_piece() const {
  const auto free = std::find_if(pieces_.begin(), pieces_.end(), [](const Piece& piece) { return piece.pixels == 0; });
  return static_cast<std::size_t>(free - pieces_.begin());
}

PieceOutcome TileMosaic::add(const PartialTile& patch, const CandidateSidecar& frame) {
  // cost_mm() of each pixel, squared.
  const double sharpness = sharpness_factor(frame.quality.sharpness_ppm);
  const auto place_mm2 = static_cast<float>(std::pow(static_cast<double>(frame.pose.sigma_mm) / sharpness, 2));
  const auto relief_mm2 = static_cast<float>(std::pow(kUnknownRelief_mm / sharpness, 2));
  cv::Mat cost_mm2(kTileSize, kTileSize, CV_32FC1), wins(kTileSize, kTileSize, CV_8UC1);
  for (int r = 0; r < kTileSize; ++r) {
    const auto* slant = patch.slants.ptr<float>(r);
    const auto* seen = patch.seen.ptr<std::uint8_t>(r);
    const auto* there = cost_mm2_.ptr<float>(r);
    auto* here = cost_mm2.ptr<float>(r);
    auto* win = wins.ptr<std::uint8_t>(r);
    for (int c = 0; c < kTileSize; ++c) {
      here[c] = place_mm2 + relief_mm2 * slant[c] * slant[c];
      win[c] = seen[c] != 0 && here[c] < kClearlyBetter * there[c] ? 255 : 0;
    }
  }
  if (cv::countNonZero(wins) < kLeastGain_px) return PieceOutcome::hidden;
  std::int64_t seam_mm = 0;
  if (missing_px_ < kTile_px) {
    const cv::Mat common = patch.seen & (owner_ != kNobody);
    const int reach_px = static_cast<int>(std::ceil(limits_.max_seam_m / pixel_m_)) + 2;
    const auto seam = measure_seam(image_, patch.image, common, reach_px);
    if (!seam || seam->correlation < limits_.min_correlation) return PieceOutcome::unproven;
    if (seam->shift_px * pixel_m_ > limits_.max_seam_m) return PieceOutcome::apart;
    seam_mm = mm(seam->shift_px * pixel_m_);
  }
  const std::size_t index = free_piece();
  if (index == pieces_.size()) return PieceOutcome::full;
  pieces_[index] = {frame, seam_mm, 0};
  patch.image.copyTo(image_, wins);
  patch.slants.copyTo(slants_, wins);
  cost_mm2.copyTo(cost_mm2_, wins);
  owner_.setTo(static_cast<int>(index), wins);
  for (std::size_t i = 0; i < pieces_.size(); ++i) pieces_[i].pixels = cv::countNonZero(owner_ == static_cast<int>(i));
  missing_px_ = cv::countNonZero(owner_ == kNobody);
  return PieceOutcome::joined;
}

std::optional<CandidateSidecar> TileMosaic::sidecar() const {
  std::vector<Piece> pieces;
  std::copy_if(pieces_.begin(), pieces_.end(), std::back_inserter(pieces), [](const Piece& p) { return p.pixels > 0; });
  std::stable_sort(pieces.begin(), pieces.end(), [](const Piece& a, const Piece& b) { return a.pixels > b.pixels; });
  const auto worst = std::max_element(pieces.begin(), pieces.end(), [](const Piece& a, const Piece& b) {
    return a.frame.pose.sigma_mm < b.frame.pose.sigma_mm;
  });
  CandidateSidecar whole = worst->frame;
  whole.key = key_;
  for (const Piece& piece : pieces) {
    const CandidateSidecar& frame = piece.frame;
    whole.captured_at = std::min(whole.captured_at, frame.captured_at);
    whole.gsd_mm = std::max(whole.gsd_mm, frame.gsd_mm);
    whole.anchor_age_ms = std::max(whole.anchor_age_ms, frame.anchor_age_ms);
    whole.quality.sharpness_ppm = std::min(whole.quality.sharpness_ppm, frame.quality.sharpness_ppm);
    whole.seam_mm = std::max(whole.seam_mm, piece.seam_mm);
    whole.parts.push_back({.frame = frame.frame,
                           .captured_at = frame.captured_at,
                           .share_ppm = std::llround(1e6 * piece.pixels / kTile_px),
                           .pose = frame.pose});
  }
  if (whole.parts.size() == 1) whole.parts.clear(), whole.seam_mm = 0;
  const std::int64_t seam_mm2 = whole.seam_mm * whole.seam_mm;
  const double sigma_mm = std::hypot(static_cast<double>(whole.pose.sigma_mm), static_cast<double>(whole.seam_mm));
  whole.pose.sigma_mm = std::llround(std::ceil(sigma_mm));
  whole.pose.cov_ee_mm2 += seam_mm2;
  whole.pose.cov_nn_mm2 += seam_mm2;
  if (whole.pose.sigma_mm > mm(limits_.soft_sigma_m)) return std::nullopt;
  whole.trust = whole.pose.sigma_mm > mm(limits_.candidate_sigma_m) ? CandidateTrust::soft : CandidateTrust::candidate;
  double slant = 0;
  cv::minMaxLoc(slants_, nullptr, &slant);
  whole.quality.view_angle_mdeg = std::llround(degrees(std::atan(slant)) * 1000);
  whole.quality.overlap_ppm = 1'000'000;
  return whole;
}

}  // namespace nadir
