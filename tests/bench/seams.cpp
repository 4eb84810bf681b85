#include "seams.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "base/quantile.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "ortho/orthorectifier.hpp"
#include "ortho/radiometric_balance.hpp"
#include "ortho/tile_mosaic.hpp"
#include "replay/score.hpp"

namespace nadir::bench {
namespace {

constexpr double kMostView_rad = radians(34);  // as candidate tiles
constexpr int kReach_px = 8;                   // displacements that are looked for
constexpr double kLeastCorrelation = 0.5;      // below it the two do not show the same
constexpr int kLeastBorder_px = 16;            // along which two frames meet
constexpr int kBand_px = 11;                   // along a border, where both show the ground

// The tiles whose pixels are just finer than a frame's.
int zoom_of(const CameraModel& camera, const LocalFrame& plane, double agl_m) {
  int zoom = 10;
  const auto gsd_m = [&](int z) {
    const GlobalPixel at = pixel_from_lonlat(plane.origin(), z);
    return distance_m(plane.plane_from_lonlat(lonlat_from_pixel({at.x, at.y}, z)),
                      plane.plane_from_lonlat(lonlat_from_pixel({at.x + 1, at.y}, z)));
  };
  while (gsd_m(zoom) > gsd_at(camera, agl_m)) ++zoom;
  return zoom;
}

struct Part {
  std::size_t frame = 0;
  PartialTile tile;
};

// Pairs of parts whose pixels are next to each other along enough of a border.
std::vector<std::pair<int, int>> meeting(const cv::Mat& owner) {
  std::map<std::pair<int, int>, int> borders;
  for (int r = 0; r + 1 < owner.rows; ++r) {
    for (int c = 0; c + 1 < owner.cols; ++c) {
      const int here = owner.at<int>(r, c);
      for (const int there : {owner.at<int>(r, c + 1), owner.at<int>(r + 1, c)}) {
        if (here >= 0 && there >= 0 && here != there) ++borders[std::minmax(here, there)];
      }
    }
  }
  std::vector<std::pair<int, int>> pairs;
  for (const auto& [pair, pixels] : borders) {
    if (pixels >= kLeastBorder_px) pairs.push_back(pair);
  }
  return pairs;
}

cv::Mat in_colour(const cv::Mat& image) {
  if (image.channels() != 1 || image.empty()) return image;
  cv::Mat colour;
  cv::cvtColor(image, colour, cv::COLOR_GRAY2BGR);
  return colour;
}

// one, other: where the orthophoto is of the first and of the second part.
std::optional<double> step_of(const PartialTile& a, const PartialTile& b, const cv::Mat& one, const cv::Mat& other) {
  cv::Mat near_one, near_other;
  const cv::Mat around = cv::Mat::ones(kBand_px, kBand_px, CV_8UC1);
  cv::dilate(one, near_one, around);
  cv::dilate(other, near_other, around);
  const cv::Mat band = near_one & near_other & a.seen & b.seen;
  if (cv::countNonZero(band) < kBand_px * kLeastBorder_px) return std::nullopt;
  cv::Mat grey_a, grey_b;
  cv::cvtColor(a.image, grey_a, cv::COLOR_BGR2GRAY);
  cv::cvtColor(b.image, grey_b, cv::COLOR_BGR2GRAY);
  return std::abs(cv::mean(grey_a, band)[0] - cv::mean(grey_b, band)[0]);
}

}  // namespace

BenchImageOf balanced_images(const CameraModel& camera, const GroundSurface& surface, const FramePoses& poses,
                             const BenchImageOf& image_of) {
  RadiometricBalance balance(surface);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!poses[i]) continue;
    const cv::Mat image = in_colour(image_of(i));
    if (!image.empty()) balance.add(static_cast<std::uint32_t>(i), image, camera, *poses[i]);
  }
  return [corrections = balance.solve(poses.size()), camera, image_of](std::size_t i) {
    cv::Mat image = in_colour(image_of(i)).clone();
    if (!image.empty()) corrections[i].apply(image, camera);
    return image;
  };
}

SeamFigures seams(const CameraModel& camera, const LocalFrame& plane, const GroundSurface& surface,
                  const FramePoses& poses, const BenchImageOf& image_of, cv::Mat* mosaic) {
  SeamFigures figures;
  const auto first = std::find_if(poses.begin(), poses.end(), [](const auto& pose) { return pose.has_value(); });
  if (first == poses.end()) return figures;
  const int zoom = zoom_of(camera, plane, (*first)->agl_m);
  std::map<std::size_t, cv::Mat> images;
  std::map<TileKey, std::vector<std::pair<std::size_t, TileProjection>>> seen;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!poses[i]) continue;
    const cv::Mat image = in_colour(image_of(i));
    if (image.empty()) continue;
    images[i] = image;
    for (auto& tile : whole_tiles(zoom, plane, camera, *poses[i], surface)) {
      seen[tile.key].emplace_back(i, std::move(tile.projection));
    }
    for (auto& tile : partial_tiles(zoom, plane, camera, *poses[i], surface)) {
      seen[tile.key].emplace_back(i, std::move(tile.projection));
    }
  }
  if (seen.empty()) return figures;
  const PlanePoint west = plane.plane_from_lonlat(
                       lonlat_from_pixel({static_cast<double>(seen.begin()->first.x) * kTileSize,
                                          static_cast<double>(seen.begin()->first.y) * kTileSize},
                                         zoom)),
                   east = plane.plane_from_lonlat(
                       lonlat_from_pixel({(static_cast<double>(seen.begin()->first.x) + 1) * kTileSize,
                                          static_cast<double>(seen.begin()->first.y) * kTileSize},
                                         zoom));
  figures.gsd_m = distance_m(west, east) / kTileSize;
  using Number = decltype(TileKey::x);
  Number left = std::numeric_limits<Number>::max(), top = left, right = 0, bottom = 0;
  for (const auto& [key, frames] : seen) {
    left = std::min(left, key.x), top = std::min(top, key.y);
    right = std::max(right, key.x), bottom = std::max(bottom, key.y);
  }
  if (mosaic != nullptr) {
    *mosaic = cv::Mat::zeros((static_cast<int>(bottom - top) + 1) * kTileSize,
                             (static_cast<int>(right - left) + 1) * kTileSize, CV_8UC3);
  }
  for (const auto& [key, frames] : seen) {
    std::vector<Part> parts;
    cv::Mat least(kTileSize, kTileSize, CV_32FC1, cv::Scalar(1e9)),
        owner(kTileSize, kTileSize, CV_32SC1, cv::Scalar(-1));
    for (const auto& [frame, projection] : frames) {
      auto part = cut_partial_tile({images.at(frame), camera}, {key, projection}, kMostView_rad);
      if (!part) continue;
      const cv::Mat better = (part->slants < least) & part->seen;
      part->slants.copyTo(least, better);
      owner.setTo(static_cast<int>(parts.size()), better);
      parts.push_back({frame, std::move(*part)});
    }
    for (const auto& [one, other] : meeting(owner)) {
      const PartialTile &a = parts[static_cast<std::size_t>(one)].tile,
                        &b = parts[static_cast<std::size_t>(other)].tile;
      const auto seam = measure_seam(a.image, b.image, a.seen & b.seen, kReach_px);
      ++figures.seams;
      if (seam && seam->correlation >= kLeastCorrelation) figures.shifts_px.push_back(seam->shift_px);
      if (const auto step = step_of(a, b, owner == one, owner == other)) figures.steps.push_back(*step);
    }
    if (mosaic == nullptr) continue;
    cv::Mat tile = (*mosaic)(cv::Rect(static_cast<int>(key.x - left) * kTileSize,
                                      static_cast<int>(key.y - top) * kTileSize, kTileSize, kTileSize));
    for (std::size_t i = 0; i < parts.size(); ++i) {
      parts[i].tile.image.copyTo(tile, owner == static_cast<int>(i));
    }
  }
  return figures;
}

nlohmann::json json_from(const SeamFigures& f) {
  return {{"seams", f.seams},
          {"measured", f.shifts_px.size()},
          {"median_px", quantile(f.shifts_px, 0.5)},
          {"p95_px", quantile(f.shifts_px, 0.95)},
          {"median_step", quantile(f.steps, 0.5)},
          {"p95_step", quantile(f.steps, 0.95)},
          {"pixel_m", f.gsd_m}};
}

}  // namespace nadir::bench
