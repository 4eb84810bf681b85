#include "ortho/tile_mosaic.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"
#include "ortho/candidate_store.hpp"

namespace nadir {
namespace {

constexpr int kCell_px = 4;             // granularity of the square
constexpr int kMinTemplate_px = 24;     // smaller ones are not distinctive
constexpr double kMinSeamContrast = 3;  // grey levels: below that it is sensor noise
constexpr int kMaxSquare_px = 160;      // larger ones add no information

// The largest square of cells that are all common, in pixels; of several the first.
cv::Rect largest_square(const cv::Mat& common) {
  const int rows = common.rows / kCell_px, columns = common.cols / kCell_px;
  cv::Mat_<int> side(rows, columns, 0);
  int best = 0;
  cv::Point end;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const cv::Mat cell = common(cv::Rect(c * kCell_px, r * kCell_px, kCell_px, kCell_px));
      if (cv::countNonZero(cell) != kCell_px * kCell_px) continue;
      side(r, c) = r == 0 || c == 0 ? 1 : 1 + std::min({side(r - 1, c), side(r, c - 1), side(r - 1, c - 1)});
      if (side(r, c) > best) best = side(r, c), end = {c + 1, r + 1};
    }
  }
  return {(end.x - best) * kCell_px, (end.y - best) * kCell_px, best * kCell_px, best * kCell_px};
}

cv::Mat grey_part(const cv::Mat& picture, const cv::Rect& part) {
  cv::Mat grey;
  cv::cvtColor(picture(part), grey, cv::COLOR_BGR2GRAY);
  return grey;
}

// Of a parabola through three neighbours, from the middle one.
double vertex(double before, double at, double after) {
  const double bend = before - 2 * at + after;
  return bend < 0 ? std::clamp((before - after) / bend / 2, -0.5, 0.5) : 0;
}

}  // namespace

std::optional<Seam> measure_seam(const cv::Mat& one, const cv::Mat& other, const cv::Mat& common, int reach_px) {
  cv::Rect square = largest_square(common);
  if (square.width < kMinTemplate_px + 2 * reach_px) return std::nullopt;
  if (const int off = square.width - std::max(kMaxSquare_px, kMinTemplate_px + 2 * reach_px); off > 0) {
    square = {square.x + off / 2, square.y + off / 2, square.width - off, square.height - off};
  }
  const int inner = square.width - 2 * reach_px;
  const cv::Mat pattern = grey_part(one, {square.x + reach_px, square.y + reach_px, inner, inner});
  cv::Scalar mean, deviation;
  cv::meanStdDev(pattern, mean, deviation);
  if (deviation[0] < kMinSeamContrast) return Seam{};
  cv::Mat scores;
  cv::matchTemplate(grey_part(other, square), pattern, scores, cv::TM_CCOEFF_NORMED);
  double best = 0;
  cv::Point at;
  cv::minMaxLoc(scores, nullptr, &best, nullptr, &at);
  if (!std::isfinite(best)) return Seam{};
  double dx = at.x - reach_px, dy = at.y - reach_px;
  const auto score = [&](int x, int y) { return static_cast<double>(scores.at<float>(y, x)); };
  if (at.x > 0 && at.x + 1 < scores.cols) dx += vertex(score(at.x - 1, at.y), best, score(at.x + 1, at.y));
  if (at.y > 0 && at.y + 1 < scores.rows) dy += vertex(score(at.x, at.y - 1), best, score(at.x, at.y + 1));
  return Seam{hypotenuse(dx, dy), best};
}

namespace {

constexpr std::uint8_t kNoPart = 255;
constexpr int kTile_px = kTileSize * kTileSize;
constexpr int kMinGain_px = 64;          // fewer are not worth another seam
constexpr float kClearlyBetter = 0.98F;  // so that equal parts do not interleave

std::int64_t mm(double metres) { return std::llround(metres * 1000); }

}  // namespace

std::string_view name_of(PartialTileOutcome outcome) {
  switch (outcome) {
    case PartialTileOutcome::merged: return "joined";
    case PartialTileOutcome::redundant: return "hidden";
    case PartialTileOutcome::unverified: return "unproven";
    case PartialTileOutcome::misaligned: return "apart";
    case PartialTileOutcome::full: return "full";
  }
  return "full";
}

TileMosaic::TileMosaic(const TileKey& key, double pixel_m, const MosaicLimits& limits)
    : key_(key),
      pixel_m_(pixel_m),
      limits_(limits),
      image_(cv::Mat::zeros(kTileSize, kTileSize, CV_8UC3)),
      slants_(cv::Mat::zeros(kTileSize, kTileSize, CV_32FC1)),
      cost_mm2_(kTileSize, kTileSize, CV_32FC1, cv::Scalar::all(INFINITY)),
      owner_(kTileSize, kTileSize, CV_8UC1, cv::Scalar::all(kNoPart)) {}

bool TileMosaic::spans(UtcMillis time) const {
  const auto most_ms = std::llround(limits_.max_span_s * 1000);
  return std::all_of(parts_.begin(), parts_.end(), [&](const Part& part) {
    return part.pixels == 0 || std::abs(time.unix_ms - part.frame.captured_at.unix_ms) <= most_ms;
  });
}

std::size_t TileMosaic::free_part() const {
  const auto free = std::find_if(parts_.begin(), parts_.end(), [](const Part& part) { return part.pixels == 0; });
  return static_cast<std::size_t>(free - parts_.begin());
}

PartialTileOutcome TileMosaic::add(const PartialTile& partial, const CandidateSidecar& frame) {
  // cost_mm() of each pixel, squared.
  const double sharpness = sharpness_factor(frame.quality.sharpness_ppm);
  const auto place_mm2 = static_cast<float>(std::pow(static_cast<double>(frame.pose.sigma_mm) / sharpness, 2));
  const auto relief_mm2 = static_cast<float>(std::pow(kUnmodelledRelief_mm / sharpness, 2));
  cv::Mat cost_mm2(kTileSize, kTileSize, CV_32FC1), wins(kTileSize, kTileSize, CV_8UC1);
  for (int r = 0; r < kTileSize; ++r) {
    const auto* slant = partial.slants.ptr<float>(r);
    const auto* seen = partial.seen.ptr<std::uint8_t>(r);
    const auto* there = cost_mm2_.ptr<float>(r);
    auto* here = cost_mm2.ptr<float>(r);
    auto* win = wins.ptr<std::uint8_t>(r);
    for (int c = 0; c < kTileSize; ++c) {
      here[c] = place_mm2 + relief_mm2 * slant[c] * slant[c];
      win[c] = seen[c] != 0 && here[c] < kClearlyBetter * there[c] ? 255 : 0;
    }
  }
  if (cv::countNonZero(wins) < kMinGain_px) return PartialTileOutcome::redundant;
  std::int64_t seam_mm = 0;
  if (missing_px_ < kTile_px) {
    const cv::Mat common = partial.seen & (owner_ != kNoPart);
    const int reach_px = static_cast<int>(std::ceil(limits_.max_seam_m / pixel_m_)) + 2;
    const auto seam = measure_seam(image_, partial.image, common, reach_px);
    if (!seam || seam->correlation < limits_.min_correlation) return PartialTileOutcome::unverified;
    if (seam->shift_px * pixel_m_ > limits_.max_seam_m) return PartialTileOutcome::misaligned;
    seam_mm = mm(seam->shift_px * pixel_m_);
  }
  const std::size_t index = free_part();
  if (index == parts_.size()) return PartialTileOutcome::full;
  parts_[index] = {frame, seam_mm, 0};
  partial.image.copyTo(image_, wins);
  partial.slants.copyTo(slants_, wins);
  cost_mm2.copyTo(cost_mm2_, wins);
  owner_.setTo(static_cast<int>(index), wins);
  for (std::size_t i = 0; i < parts_.size(); ++i) parts_[i].pixels = cv::countNonZero(owner_ == static_cast<int>(i));
  missing_px_ = cv::countNonZero(owner_ == kNoPart);
  return PartialTileOutcome::merged;
}

std::optional<CandidateSidecar> TileMosaic::sidecar() const {
  std::vector<Part> parts;
  std::copy_if(parts_.begin(), parts_.end(), std::back_inserter(parts), [](const Part& p) { return p.pixels > 0; });
  std::stable_sort(parts.begin(), parts.end(), [](const Part& a, const Part& b) { return a.pixels > b.pixels; });
  const auto worst = std::max_element(parts.begin(), parts.end(), [](const Part& a, const Part& b) {
    return a.frame.pose.sigma_mm < b.frame.pose.sigma_mm;
  });
  CandidateSidecar whole = worst->frame;
  whole.key = key_;
  for (const Part& part : parts) {
    const CandidateSidecar& frame = part.frame;
    whole.captured_at = std::min(whole.captured_at, frame.captured_at);
    whole.gsd_mm = std::max(whole.gsd_mm, frame.gsd_mm);
    whole.anchor_age_ms = std::max(whole.anchor_age_ms, frame.anchor_age_ms);
    whole.quality.sharpness_ppm = std::min(whole.quality.sharpness_ppm, frame.quality.sharpness_ppm);
    whole.seam_mm = std::max(whole.seam_mm, part.seam_mm);
    whole.parts.push_back({.frame = frame.frame,
                           .captured_at = frame.captured_at,
                           .share_ppm = std::llround(1e6 * part.pixels / kTile_px),
                           .pose = frame.pose});
  }
  if (whole.parts.size() == 1) whole.parts.clear(), whole.seam_mm = 0;
  const std::int64_t seam_mm2 = whole.seam_mm * whole.seam_mm;
  const double sigma_mm = hypotenuse(static_cast<double>(whole.pose.sigma_mm), static_cast<double>(whole.seam_mm));
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

void TileMosaics::close(std::list<Waiting>::iterator waiting) {
  if (waiting->mosaic.whole()) {
    finished_.push_back(std::move(waiting->mosaic));
  } else {
    ++dropped_;
  }
  waiting_.erase(waiting);
}

PartialTileOutcome TileMosaics::add(const PartialTile& partial, const CandidateSidecar& frame, double pixel_m) {
  auto found = std::find_if(waiting_.begin(), waiting_.end(),
                            [&](const Waiting& waiting) { return waiting.mosaic.key() == partial.key; });
  if (found != waiting_.end() && !found->mosaic.spans(frame.captured_at)) {
    close(found);
    found = waiting_.end();
  }
  if (found == waiting_.end()) {
    if (waiting_.size() >= limits_.max_open) close(waiting_.begin());
    found = waiting_.insert(waiting_.end(), {TileMosaic(partial.key, pixel_m, limits_)});
  }
  PartialTileOutcome outcome = found->mosaic.add(partial, frame);
  const bool not_merged = outcome != PartialTileOutcome::merged && outcome != PartialTileOutcome::redundant;
  if (not_merged && partial.seen_px > found->mosaic.shown_px()) {
    // The earlier must not block what shows more: there is no telling which of the two is right.
    found->mosaic = TileMosaic(partial.key, pixel_m, limits_);
    found->mosaic.add(partial, frame);
    found->extended = true;
  }
  if (outcome == PartialTileOutcome::merged) {
    found->extended = true;
    waiting_.splice(waiting_.end(), waiting_, found);
  }
  return outcome;
}

std::vector<TileMosaic> TileMosaics::take_finished() {
  for (auto waiting = waiting_.begin(); waiting != waiting_.end();) {
    const auto here = waiting++;
    if (here->mosaic.whole() && !here->extended) {
      close(here);
    } else {
      here->extended = false;
    }
  }
  std::sort(finished_.begin(), finished_.end(),
            [](const TileMosaic& a, const TileMosaic& b) { return a.key() < b.key(); });
  return std::exchange(finished_, {});
}

std::vector<TileMosaic> TileMosaics::take_all_complete() {
  while (!waiting_.empty()) close(waiting_.begin());
  return take_finished();
}

}  // namespace nadir
