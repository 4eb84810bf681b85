#include "ortho/surface_model.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <set>
#include <tuple>
#include <utility>

#include "base/quantile.hpp"
#include "vision/correlation.hpp"

namespace nadir {
namespace {

constexpr double kPixelsAcross = 600;              // of the longer side of a footprint, in the last round; chosen
constexpr std::array kCoarser = {4, 2, 1, 1};      // pixels of each round over those of the last; chosen
constexpr int kHeightCell_px = 16, kPart_px = 32;  // what gets a height, and what is registered for it; chosen
constexpr int kReach_px = 8;                       // displacements that are looked for; chosen
constexpr double kLeastContrast = 3;    // grey levels of a part: below it is noise; as of seams (tile_mosaic.cpp)
constexpr double kLeastScore = 0.6;     // correlation coefficient; below it the two do not show the same; chosen
constexpr double kLeastBase = 0.05;     // |s_b - s_a|: what is seen from one side has no height; chosen
constexpr double kMostAcross_px = 1.5;  // beyond it the displacement is none by a height; chosen
constexpr double kMostOfDepth = 0.3;    // a correction at once, of the height of the cameras above; chosen
constexpr double kMostAbove = 2;  // times the usual height: a frame from higher up shows less than is wanted; chosen
constexpr int kNeighbourDirections = 8;  // a frame is compared with the nearest in each; chosen
constexpr std::size_t kLeastAround = 6;  // of nine cells, for their median to be one of a slope; chosen
// Of a footprint, between the middles of two that are compared: closer ones see the ground from one side; chosen.
constexpr double kLeastAway = 0.1, kMostAway = 0.9;

std::uint64_t key_of(std::int32_t column, std::int32_t row) {
  return static_cast<std::uint64_t>(static_cast<std::uint32_t>(column)) << 32 | static_cast<std::uint32_t>(row);
}

std::int32_t cell_at(double at_m, double cell_m) { return static_cast<std::int32_t>(std::floor(at_m / cell_m)); }

struct SurfaceFrame {
  ReducedFrame picture;
  CameraPose pose;  // over the terrain
  double up_m = 0;  // of the camera, over the plane
  PlaneBox seen{};  // on level ground
  PlanePoint middle;
};

// What two frames say of the height of a cell.
struct Height {
  std::int32_t row = 0, column = 0;
  double correction_m = 0, weight = 1;

  std::pair<std::int32_t, std::int32_t> cell() const { return {row, column}; }
};

// The least value up to which half of the weight lies. Sorts.
double weighted_median(std::span<std::pair<double, double>> values) {
  std::sort(values.begin(), values.end());
  double whole = 0, sum = 0;
  for (const auto& [value, weight] : values) whole += weight;
  for (const auto& [value, weight] : values) {
    sum += weight;
    if (2 * sum >= whole) return value;
  }
  return 0;
}

// Each frame and the nearest in each direction that sees the ground from another side: those whose parts of an
// orthophoto meet.
std::vector<std::pair<std::size_t, std::size_t>> neighbours(const std::vector<SurfaceFrame>& frames, double side_m) {
  std::set<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    std::array<std::pair<double, std::size_t>, kNeighbourDirections> nearest;
    nearest.fill({kMostAway * side_m, i});
    for (std::size_t j = 0; j < frames.size(); ++j) {
      const Eigen::Vector2d way = frames[j].middle - frames[i].middle;
      const double away_m = way.norm();
      if (!(away_m >= kLeastAway * side_m && away_m < kMostAway * side_m)) continue;
      const double turns = std::atan2(way.y(), way.x()) / (2 * std::numbers::pi) + 0.5;
      auto& there = nearest[static_cast<std::size_t>(turns * kNeighbourDirections) % kNeighbourDirections];
      there = std::min(there, {away_m, j});
    }
    for (const auto& [away_m, j] : nearest) {
      if (j != i) pairs.insert(std::minmax(i, j));
    }
  }
  return {pairs.begin(), pairs.end()};
}

// What one round has measured.
struct Round {
  double gsd_m = 1;
  std::vector<Height> heights;
  std::vector<double> along_px, across_px;

  double cell_m() const { return kHeightCell_px * gsd_m; }
};

// Metres aside for a metre down, from the camera to the ground.
Eigen::Vector2d lean(const SurfaceFrame& frame, PlanePoint ground, double height_m) {
  return (ground - frame.pose.position) / (frame.up_m - height_m);
}

// By how much a part of the ground is displaced in the second orthophoto against the first, pixels east and north;
// nothing where they do not show the same.
std::optional<Eigen::Vector2d> displacement_px(const RectifiedFrame& one, const RectifiedFrame& other,
                                               const cv::Rect& part) {
  const cv::Rect window(part.x - kReach_px, part.y - kReach_px, part.width + 2 * kReach_px,
                        part.height + 2 * kReach_px);
  if ((window & cv::Rect({0, 0}, one.mask.size())) != window) return std::nullopt;
  if (cv::countNonZero(one.mask(part)) != part.area() || cv::countNonZero(other.mask(window)) != window.area()) {
    return std::nullopt;
  }
  cv::Scalar mean, deviation;
  cv::meanStdDev(one.image(part), mean, deviation);
  if (!(deviation[0] >= kLeastContrast)) return std::nullopt;
  cv::Mat scores;
  cv::matchTemplate(other.image(window), one.image(part), scores, cv::TM_CCOEFF_NORMED);
  const Peak peak = best_peak(scores);
  const bool inside = std::abs(peak.x - kReach_px) < kReach_px && std::abs(peak.y - kReach_px) < kReach_px;
  if (!inside || !(peak.score >= kLeastScore)) return std::nullopt;
  return Eigen::Vector2d(peak.x - kReach_px, kReach_px - peak.y);
}

// The orthophotos of two frames over one grid, whose cells are those of the model.
void compare(const SurfaceFrame& a, const SurfaceFrame& b, const SurfaceModel& surface, Round& round) {
  const PlaneBox both{std::max(a.seen.west_m, b.seen.west_m), std::max(a.seen.south_m, b.seen.south_m),
                      std::min(a.seen.east_m, b.seen.east_m), std::min(a.seen.north_m, b.seen.north_m)};
  const double cell_m = round.cell_m();
  const std::int32_t west = cell_at(both.west_m, cell_m), south = cell_at(both.south_m, cell_m);
  const std::int32_t columns = cell_at(both.east_m, cell_m) + 1 - west,
                     rows = cell_at(both.north_m, cell_m) + 1 - south;
  constexpr int kLeast_px = kPart_px + 2 * kReach_px;
  if (columns * kHeightCell_px < kLeast_px || rows * kHeightCell_px < kLeast_px) return;
  const GroundGrid grid{west * cell_m, (south + rows) * cell_m, round.gsd_m, columns * kHeightCell_px,
                        rows * kHeightCell_px};
  const auto seen_by = [&](const SurfaceFrame& frame) {
    return rectify(frame.picture, surface.over_surface(frame.pose), grid, surface);
  };
  const RectifiedFrame of_a = seen_by(a), of_b = seen_by(b);
  for (int row = 1; row < rows; ++row) {
    for (int column = 1; column < columns; ++column) {
      const PlanePoint at = grid.plane_from_pixel(column * kHeightCell_px, row * kHeightCell_px);
      const double height_m = surface.height_m(at);
      const Eigen::Vector2d base = lean(b, at, height_m) - lean(a, at, height_m);
      if (!(base.norm() >= kLeastBase)) continue;
      const auto moved_px = displacement_px(
          of_a, of_b,
          {column * kHeightCell_px - kPart_px / 2, row * kHeightCell_px - kPart_px / 2, kPart_px, kPart_px});
      if (!moved_px) continue;
      const Eigen::Vector2d along = base.normalized();
      const double along_px = moved_px->dot(along), across_px = moved_px->x() * along.y() - moved_px->y() * along.x();
      const double correction_m = along_px * round.gsd_m / base.norm();
      const double depth_m = std::min(a.up_m, b.up_m) - height_m;
      if (std::abs(across_px) > kMostAcross_px || !(std::abs(correction_m) <= kMostOfDepth * depth_m)) continue;
      round.along_px.push_back(std::abs(along_px));
      round.across_px.push_back(std::abs(across_px));
      round.heights.push_back({south + rows - row, west + column, correction_m, base.squaredNorm()});
    }
  }
}

// Of each cell the median of what its pairs say; then of the heights that it and its eight neighbours get by that: a
// wrong one does not stand up, an edge stays one, a slope too. Cells beside measured ones follow them.
std::vector<SurfaceModel::Correction> corrections_from(std::vector<Height> heights, const SurfaceModel& surface,
                                                       double cell_m) {
  std::stable_sort(heights.begin(), heights.end(),
                   [](const Height& a, const Height& b) { return a.cell() < b.cell(); });
  struct Measured {
    double correction_m = 0, height_m = 0, weight = 0;  // height_m: with the correction
  };
  const auto modelled_m = [&](std::int32_t column, std::int32_t row) {
    return surface.height_m({column * cell_m, row * cell_m});
  };
  std::vector<std::pair<double, double>> values;
  std::unordered_map<std::uint64_t, Measured> cells;
  std::set<std::pair<std::int32_t, std::int32_t>> places;  // those and the ones around them
  for (auto first = heights.begin(); first != heights.end();) {
    const auto last = std::find_if(first, heights.end(), [&](const Height& h) { return h.cell() != first->cell(); });
    values.clear();
    double weight = 0;
    for (auto h = first; h != last; ++h) values.emplace_back(h->correction_m, h->weight), weight += h->weight;
    const double correction_m = weighted_median(values);
    cells[key_of(first->column, first->row)] = {correction_m, modelled_m(first->column, first->row) + correction_m,
                                                weight};
    for (int r = -1; r <= 1; ++r) {
      for (int c = -1; c <= 1; ++c) places.emplace(first->row + r, first->column + c);
    }
    first = last;
  }
  std::vector<SurfaceModel::Correction> corrections;
  for (const auto& [row, column] : places) {
    const auto own = cells.find(key_of(column, row));
    const bool measured = own != cells.end();
    values.clear();
    for (int r = -1; r <= 1; ++r) {
      for (int c = -1; c <= 1; ++c) {
        const auto cell = cells.find(key_of(column + c, row + r));
        if (cell == cells.end()) continue;
        values.emplace_back(measured ? cell->second.height_m : cell->second.correction_m, cell->second.weight);
      }
    }
    double correction_m = 0;
    if (!measured) {
      correction_m = weighted_median(values);
    } else if (values.size() < kLeastAround) {
      correction_m = own->second.correction_m;
    } else {
      correction_m = weighted_median(values) - (own->second.height_m - own->second.correction_m);
    }
    corrections.push_back({column, row, correction_m});
  }
  return corrections;
}

}  // namespace

double SurfaceModel::height_m(PlanePoint point) const {
  double height_m = terrain_->height_m(point);
  for (const Round& round : rounds_) {
    const double x = point.east_m / round.cell_m, y = point.north_m / round.cell_m;
    if (!(std::abs(x) < std::numeric_limits<std::int32_t>::max() - 2.0) ||
        !(std::abs(y) < std::numeric_limits<std::int32_t>::max() - 2.0)) {
      continue;
    }
    const auto column = static_cast<std::int32_t>(std::floor(x)), row = static_cast<std::int32_t>(std::floor(y));
    const auto at = [&](std::int32_t c, std::int32_t r) {
      const auto found = round.heights_m.find(key_of(c, r));
      return found == round.heights_m.end() ? 0.0 : static_cast<double>(found->second);
    };
    const double u = x - column, v = y - row;
    height_m += (1 - v) * ((1 - u) * at(column, row) + u * at(column + 1, row)) +
                v * ((1 - u) * at(column, row + 1) + u * at(column + 1, row + 1));
  }
  return height_m;
}

CameraPose SurfaceModel::over_surface(const CameraPose& over_terrain) const {
  CameraPose pose = over_terrain;
  pose.agl_m += terrain_->height_m(pose.position) - height_m(pose.position);
  return pose;
}

void SurfaceModel::add(double cell_m, std::span<const Correction> corrections) {
  Round& round = rounds_.emplace_back();
  round.cell_m = cell_m;
  for (const Correction& c : corrections) round.heights_m[key_of(c.column, c.row)] = static_cast<float>(c.height_m);
}

SurfaceModel surface_from_frames(const CameraModel& camera, const GroundSurface& terrain,
                                 std::span<const std::optional<CameraPose>> poses, const PictureOf& picture_of,
                                 Progress& progress, SurfaceModelFigures* figures) {
  SurfaceModel surface(terrain);
  std::vector<double> heights_m;
  for (const auto& pose : poses) {
    if (pose) heights_m.push_back(pose->agl_m);
  }
  if (heights_m.empty()) return surface;
  const double agl_m = median(heights_m), side_m = footprint_side_m(camera, agl_m);
  const double gsd_m = std::max(side_m / kPixelsAcross, gsd_at(camera, agl_m));
  std::vector<SurfaceFrame> frames;
  progress.begin("pictures", poses.size(), "frames");
  for (std::size_t i = 0; i < poses.size(); ++i, progress.advance(1)) {
    if (!poses[i]) continue;
    const CameraPose& pose = *poses[i];
    const auto seen = pose.agl_m <= kMostAbove * agl_m ? footprint_of(camera, pose) : std::nullopt;
    const cv::Mat picture = seen ? picture_of(i) : cv::Mat();
    const auto middle = ground_from_ray(pose, camera.ray_from_pixel({camera.cx, camera.cy}));
    if (picture.empty() || !middle) continue;
    frames.push_back({reduce_frame(picture, camera, pose.agl_m, gsd_m), pose,
                      terrain.height_m(pose.position) + pose.agl_m, *seen, *middle});
  }
  progress.end();
  const auto pairs = neighbours(frames, side_m);
  progress.begin("heights of the ground", kCoarser.size() * pairs.size(), "pairs of frames");
  for (const int coarser : kCoarser) {
    Round round;
    round.gsd_m = coarser * gsd_m;
    for (const auto& [a, b] : pairs) {
      compare(frames[a], frames[b], surface, round);
      progress.advance(1);
    }
    if (figures != nullptr) {
      *figures = {pairs.size(), round.heights.size(), round.gsd_m, median(round.along_px), median(round.across_px)};
    }
    surface.add(round.cell_m(), corrections_from(std::move(round.heights), surface, round.cell_m()));
  }
  progress.end();
  return surface;
}

}  // namespace nadir
