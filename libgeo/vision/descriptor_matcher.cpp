#include "vision/descriptor_matcher.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <utility>

#include "geodesy/angles.hpp"
#include "vision/correlation.hpp"
#include "vision/matching_plan.hpp"
#include "vision/patch_matching.hpp"
#include "vision/pose_refinement.hpp"

namespace nadir {

using namespace parameters::learned_matching;

namespace {

// A turn of the camera (clockwise, as headings) and a relative height, against those that a frame was described with.
struct CellTrial {
  double turn_rad = 0;
  double scale = 1;
};

CameraPose posed(const CameraPose& pose, const CellTrial& trial, PlanePoint position) {
  CameraPose result = pose;
  result.attitude.heading_rad += trial.turn_rad;
  result.agl_m *= trial.scale;
  result.position = position;
  return result;
}

// Whole cells of side cell_m around what the camera sees in all of the poses; its corner is whole cells from `from`.
// Nothing where it sees the horizon, or more cells than `most`.
std::optional<GroundGrid> cell_grid(const CameraModel& camera, const std::vector<CameraPose>& poses, double cell_m,
                                    PlanePoint from, cv::Size most) {
  PlaneBox all{1, 1, -1, -1};
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const auto box = footprint_of(camera, poses[i]);
    if (!box) return std::nullopt;
    if (i == 0) all = *box;
    all = {std::min(all.west_m, box->west_m), std::min(all.south_m, box->south_m), std::max(all.east_m, box->east_m),
           std::max(all.north_m, box->north_m)};
  }
  const double left = std::floor((all.west_m - from.east_m) / cell_m),
               top = std::floor((from.north_m - all.north_m) / cell_m);
  GroundGrid grid;
  grid.gsd_m = cell_m;
  grid.west_m = from.east_m + left * cell_m;
  grid.north_m = from.north_m - top * cell_m;
  const double columns = std::ceil((all.east_m - grid.west_m) / cell_m),
               rows = std::ceil((grid.north_m - all.south_m) / cell_m);
  if (!(columns <= most.width && rows <= most.height)) return std::nullopt;
  grid.columns = static_cast<int>(columns);
  grid.rows = static_cast<int>(rows);
  return grid;
}

// The map's cells in a window.
struct MapCells {
  MapCells(const MapWindow& window, DenseDescriptorNetwork& network, int principal, const Cancel& cancel)
      : gsd_m(window.gsd_m),
        cell_m(window.gsd_m * kDescriptorCell_px),
        corner{window.west_m, window.north_m},
        all(described(network, window.image, window.mask, cancel)),
        directions(all, principal),
        picture(directions.project(all)) {}

  double gsd_m, cell_m;
  PlanePoint corner;  // north-west
  DescribedPicture all;
  PrincipalChannels directions;
  DescribedPicture picture;  // in those

  cv::Point cell_of(const GroundGrid& grid) const {
    return {static_cast<int>(std::lround((grid.west_m - corner.east_m) / cell_m)),
            static_cast<int>(std::lround((corner.north_m - grid.north_m) / cell_m))};
  }
};

// A frame's cells in the map's principal channels.
struct FrameCells {
  CameraPose pose;  // that it was rectified with
  GroundGrid grid;  // of the cells
  DescribedPicture picture;
  RectifiedFrame rectified;
};

// The cells as they would lie under another heading and height: the ground turns and grows around the point under the
// camera. Linear between cells; valid where all four are.
DescribedPicture turned(const FrameCells& frame, const CellTrial& trial, const GroundGrid& grid) {
  const int channels = frame.picture.cells.channels();
  DescribedPicture result{cv::Mat::zeros(grid.rows, grid.columns, frame.picture.cells.type()),
                          cv::Mat::zeros(grid.rows, grid.columns, CV_8UC1)};
  const double cosine = std::cos(trial.turn_rad) / trial.scale, sine = std::sin(trial.turn_rad) / trial.scale;
  const PlanePoint foot = frame.pose.position;
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) {
      const PlanePoint at = grid.plane_from_pixel(c + 0.5, r + 0.5);
      const double east = at.east_m - foot.east_m, north = at.north_m - foot.north_m;
      const double column = (foot.east_m + cosine * east - sine * north - frame.grid.west_m) / frame.grid.gsd_m - 0.5,
                   row = (frame.grid.north_m - foot.north_m - sine * east - cosine * north) / frame.grid.gsd_m - 0.5;
      const int left = static_cast<int>(std::floor(column)), top = static_cast<int>(std::floor(row));
      if (left < 0 || top < 0 || left + 1 >= frame.picture.mask.cols || top + 1 >= frame.picture.mask.rows) continue;
      const auto *upper = frame.picture.mask.ptr<std::uint8_t>(top) + left,
                 *lower = frame.picture.mask.ptr<std::uint8_t>(top + 1) + left;
      if ((upper[0] & upper[1] & lower[0] & lower[1]) == 0) continue;
      const auto right_share = static_cast<float>(column - left), lower_share = static_cast<float>(row - top);
      const auto *a = frame.picture.cells.ptr<float>(top) + left * channels,
                 *b = frame.picture.cells.ptr<float>(top + 1) + left * channels;
      auto* to = result.cells.ptr<float>(r) + c * channels;
      for (int k = 0; k < channels; ++k) {
        const float above = a[k] + right_share * (a[k + channels] - a[k]),
                    below = b[k] + right_share * (b[k + channels] - b[k]);
        to[k] = above + lower_share * (below - above);
      }
      result.mask.at<std::uint8_t>(r, c) = 255;
    }
  }
  return result;
}

// The score of correlation.hpp for few placements, summed directly: `part` of the frame with its corner at `first` of
// the map's cells and beside it. What lies beyond the map is not valid.
cv::Mat cell_scores(const DescribedPicture& frame, const cv::Rect& part, const DescribedPicture& map, cv::Point first,
                    cv::Size placements, double min_valid) {
  const auto channels = static_cast<std::size_t>(frame.cells.channels());
  const double all = cv::countNonZero(frame.mask(part));
  cv::Mat scores(placements, CV_32FC1, cv::Scalar(-1));
  std::vector<double> frame_sum(channels), map_sum(channels);
  for (int y = 0; y < placements.height; ++y) {
    for (int x = 0; x < placements.width; ++x) {
      std::fill(frame_sum.begin(), frame_sum.end(), 0);
      std::fill(map_sum.begin(), map_sum.end(), 0);
      double cells = 0, products = 0, frame_squares = 0, map_squares = 0;
      const cv::Point to = first + cv::Point(x, y) - part.tl();
      const cv::Rect used = part & cv::Rect(-to.x, -to.y, map.mask.cols, map.mask.rows);
      for (int r = used.y; r < used.y + used.height; ++r) {
        const auto* frame_mask = frame.mask.ptr<std::uint8_t>(r);
        const auto* map_mask = map.mask.ptr<std::uint8_t>(r + to.y);
        for (int c = used.x; c < used.x + used.width; ++c) {
          if (frame_mask[c] == 0 || map_mask[c + to.x] == 0) continue;
          ++cells;
          const auto* a = frame.cells.ptr<float>(r) + static_cast<std::size_t>(c) * channels;
          const auto* b = map.cells.ptr<float>(r + to.y) + static_cast<std::size_t>(c + to.x) * channels;
          float product = 0, square_a = 0, square_b = 0;
          for (std::size_t k = 0; k < channels; ++k) {
            product += a[k] * b[k], square_a += a[k] * a[k], square_b += b[k] * b[k];
            frame_sum[k] += static_cast<double>(a[k]), map_sum[k] += static_cast<double>(b[k]);
          }
          products += static_cast<double>(product);
          frame_squares += static_cast<double>(square_a), map_squares += static_cast<double>(square_b);
        }
      }
      if (cells == 0 || cells < min_valid * all) continue;
      for (std::size_t k = 0; k < channels; ++k) {
        products -= frame_sum[k] * map_sum[k] / cells;
        frame_squares -= frame_sum[k] * frame_sum[k] / cells, map_squares -= map_sum[k] * map_sum[k] / cells;
      }
      const double norm2 = frame_squares * map_squares;
      if (norm2 > kMinVariance * cells * kMinVariance * cells)
        scores.at<float>(y, x) = static_cast<float>(products / std::sqrt(norm2));
    }
  }
  return scores;
}

class DescriptorMatcher final : public MapMatcher {
 public:
  DescriptorMatcher(const MatcherMap& map, std::shared_ptr<DenseDescriptorNetwork> network,
                    const DescriptorMatching& how)
      : map_(map), network_(std::move(network)), how_(how), reader_(map.tiles, kCachedMapTiles) {}

  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
    const auto plan = plan_for(prior);
    if (!plan) return {};
    AnchorPrior wide = prior;
    wide.search.radius_m = std::max(prior.search.radius_m, kMinWindowDistinct * plan->options.distinct_m);
    AnchorMatch match = begin_match(*plan);
    const MapWindow window = cropped_to_map(
        reader_.read(map_.frame, searched_ground(map_.camera, wide, *plan), plan->scale.fine_gsd_m, Colour::grey),
        plan->reach_m / 2);
    match.on_map = cv::countNonZero(window.mask) > 0;
    if (!match.on_map) return match;
    const MapCells cells(window, *network_, how_.principal_channels, prior.cancel);
    match.search = best_of(search(grey, wide.search, cells, *plan), plan->options);
    if (!match.search.places.empty()) refine(match, grey, window, cells, prior, *plan);
    return match;
  }

  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
    const auto plan = plan_for(prior);
    if (!plan) return {};
    AnchorMatch match = begin_match(*plan);
    match.on_map = false;
    std::vector<MatchHypothesis> all;
    for (const SearchPrior& part : windows_over(area, prior.search)) {
      prior.cancel.check();
      const MapWindow window = read_around(part.pose.position, part.radius_m, *plan);
      if (cv::countNonZero(window.mask) == 0) continue;
      match.on_map = true;
      const MapCells cells(window, *network_, how_.principal_channels, prior.cancel);
      const auto found = search(grey, part, cells, *plan);
      all.insert(all.end(), found.begin(), found.end());
    }
    match.search = best_of(std::move(all), plan->options);
    if (match.search.places.empty()) return match;
    const MapWindow window = read_around(match.search.places.front().pose.position, kRefinementSlack_m, *plan);
    refine(match, grey, window, MapCells(window, *network_, how_.principal_channels, prior.cancel), prior, *plan);
    return match;
  }

 private:
  std::optional<MatchingPlan> plan_for(const AnchorPrior& prior) const {
    auto plan = matching_plan(map_.camera, reader_.zooms(), map_.frame, prior.search);
    if (!plan) return plan;
    const double side_m = footprint_side_m(map_.camera, prior.search.pose.agl_m);
    plan->scale.fine_gsd_m = std::max(plan->scale.fine_gsd_m, side_m / how_.frame_px);
    plan->options.cancel = prior.cancel;
    return plan;
  }

  MapWindow read_around(PlanePoint middle, double radius_m, const MatchingPlan& plan) {
    return cropped_to_map(
        reader_.read(map_.frame, square_around(middle, radius_m + plan.reach_m), plan.scale.fine_gsd_m, Colour::grey),
        plan.reach_m / 2);
  }

  // The frame under a pose, on cells that are whole cells from `from`.
  std::optional<FrameCells> describe_frame(const ReducedFrame& frame, const CameraPose& pose, const MapCells& map,
                                           PlanePoint from, const GroundSurface& surface, const Cancel& cancel) const {
    // Patches that agree by chance may solve for a camera in space: what shows much more than the map is no match, and
    // would take any amount of memory.
    const auto grid = cell_grid(frame.camera, {pose}, map.cell_m, from, map.picture.mask.size() * 2);
    if (!grid) return std::nullopt;
    GroundGrid pixels = *grid;
    pixels.gsd_m = map.gsd_m;
    pixels.columns *= kDescriptorCell_px;
    pixels.rows *= kDescriptorCell_px;
    FrameCells cells{pose, *grid, {}, rectify(frame, pose, pixels, surface)};
    cells.picture = map.directions.project(described(*network_, cells.rectified.image, cells.rectified.mask, cancel));
    return cells;
  }

  std::vector<MatchHypothesis> search(const cv::Mat& grey, const SearchPrior& prior, const MapCells& map,
                                      const MatchingPlan& plan) const {
    const std::vector<FrameCells> views =
        describe_views(reduce_frame(grey, map_.camera, prior.pose.agl_m, map.gsd_m), prior, map, plan.options);
    if (views.empty()) return {};
    std::vector<MatchHypothesis> places = sweep(views, prior, map, plan);
    places.resize(std::min(kConfirmedPlaces, places.size()));
    for (MatchHypothesis& place : places) confirm(place, views, map, plan.options.cancel);
    return places;
  }

  // The frame on the ground beneath the plane's origin, under headings so far apart that each serves those around it.
  std::vector<FrameCells> describe_views(const ReducedFrame& frame, const SearchPrior& prior, const MapCells& map,
                                         const SearchOptions& options) const {
    const auto count = static_cast<int>(std::ceil(std::max(1e-9, prior.heading_range_rad / kDescribedTurn_rad)));
    std::vector<FrameCells> views;
    for (int i = 0; i < count; ++i) {
      const double turn_rad = prior.heading_range_rad * ((2 * i + 1.0) / count - 1);
      auto view = describe_frame(frame, posed(prior.pose, {turn_rad, 1}, {}), map, {}, FlatGround(), options.cancel);
      if (!view) return {};
      views.push_back(std::move(*view));
    }
    return views;
  }

  // The frame as it would be seen in this pose, by the view nearest to its heading. grid: around the pose's position.
  static DescribedPicture seen_from(const CameraPose& pose, const std::vector<FrameCells>& views, GroundGrid grid) {
    const auto turn_from = [&](const FrameCells& view) {
      return wrap_pi(pose.attitude.heading_rad - view.pose.attitude.heading_rad);
    };
    const auto nearest = std::min_element(views.begin(), views.end(), [&](const FrameCells& a, const FrameCells& b) {
      return std::abs(turn_from(a)) < std::abs(turn_from(b));
    });
    grid.west_m -= pose.position.east_m;
    grid.north_m -= pose.position.north_m;
    return turned(*nearest, {turn_from(*nearest), pose.agl_m / nearest->pose.agl_m}, grid);
  }

  std::vector<MatchHypothesis> sweep(const std::vector<FrameCells>& views, const SearchPrior& prior,
                                     const MapCells& map, const MatchingPlan& plan) const {
    const SearchOptions& options = plan.options;
    std::vector<CameraPose> poses;
    for (const double turn : offsets_within(prior.heading_range_rad, options.heading_step_rad)) {
      for (const double scale : offsets_within(prior.scale_range, options.scale_step)) {
        poses.push_back(posed(prior.pose, {turn, 1 + scale}, {}));
      }
    }
    const auto grid = cell_grid(map_.camera, poses, map.cell_m, {}, map.picture.mask.size());
    if (!grid) return {};
    const WindowSpectra spectra(channels_of(map.picture), cv::Size(grid->columns, grid->rows));
    const std::size_t kept = options.candidates * kWideCandidates;
    std::vector<MatchHypothesis> found;
    for (const CameraPose& pose : poses) {
      options.cancel.check();
      const Channels pattern = channels_of(seen_from(pose, views, *grid));
      const cv::Mat scores = correlate(pattern, spectra, TemplateNorm(pattern, spectra));
      keep_peaks(found, scores, *grid, pose, prior, map, kept, options);
    }
    return distinct_places(std::move(found), options.distinct_m, kept);
  }

  static void keep_peaks(std::vector<MatchHypothesis>& found, const cv::Mat& scores, const GroundGrid& grid,
                         const CameraPose& pose, const SearchPrior& prior, const MapCells& map, std::size_t count,
                         const SearchOptions& options) {
    const PlanePoint middle = prior.pose.position;
    const int left = static_cast<int>(
                  std::floor((middle.east_m - prior.radius_m + grid.west_m - map.corner.east_m) / map.cell_m)),
              top = static_cast<int>(
                  std::floor((map.corner.north_m - middle.north_m - prior.radius_m - grid.north_m) / map.cell_m)),
              side = static_cast<int>(std::ceil(2 * prior.radius_m / map.cell_m)) + 1;
    const cv::Rect part = cv::Rect(left, top, side, side) & cv::Rect(cv::Point(), scores.size());
    if (part.empty()) return;
    for (const Peak& peak : distinct_peaks(scores(part), count, options.distinct_m / map.cell_m)) {
      MatchHypothesis& hypothesis = found.emplace_back();
      hypothesis.pose = pose;
      hypothesis.pose.position = {map.corner.east_m + (peak.x + part.x) * map.cell_m - grid.west_m,
                                  map.corner.north_m - (peak.y + part.y) * map.cell_m - grid.north_m};
      hypothesis.coarse_score = hypothesis.score = peak.score;
    }
  }

  static std::vector<MatchHypothesis> distinct_places(std::vector<MatchHypothesis> found, double distinct_m,
                                                      std::size_t count) {
    SearchOptions options;
    options.distinct_m = distinct_m;
    options.candidates = count;
    return best_of(std::move(found), options).places;
  }

  // The best pose near a hypothesis, on the map's cells.
  void confirm(MatchHypothesis& hypothesis, const std::vector<FrameCells>& views, const MapCells& map,
               const Cancel& cancel) const {
    hypothesis.score = -1;
    const CameraPose begin = hypothesis.pose;
    const auto grid = cell_grid(map_.camera, {begin}, map.cell_m, map.corner, map.picture.mask.size() * 2);
    if (!grid) return;
    const cv::Point expected = map.cell_of(*grid), slack(kConfirmSlack_cells, kConfirmSlack_cells);
    const cv::Size placements(2 * kConfirmSlack_cells + 1, 2 * kConfirmSlack_cells + 1);
    for (const double turn : {0.0, -kHeadingStep_rad / 2, kHeadingStep_rad / 2}) {
      for (const double scale : {0.0, -kScaleStep / 2, kScaleStep / 2}) {
        cancel.check();
        const CellTrial trial{turn, 1 + scale};
        const DescribedPicture pattern = seen_from(posed(begin, trial, begin.position), views, *grid);
        const Peak peak = best_peak(cell_scores(pattern, cv::Rect(cv::Point(), pattern.mask.size()), map.picture,
                                                expected - slack, placements, kMinValidShare));
        if (peak.score <= hypothesis.score) continue;
        hypothesis.score = peak.score;
        hypothesis.pose = posed(begin, trial,
                                {begin.position.east_m + (peak.x - slack.x) * map.cell_m,
                                 begin.position.north_m - (peak.y - slack.y) * map.cell_m});
      }
    }
  }

  // Patches, then the pose from them, then patches again with that pose.
  void refine(AnchorMatch& match, const cv::Mat& grey, const MapWindow& window, const MapCells& map,
              const AnchorPrior& prior, const MatchingPlan& plan) {
    const CameraPose& begin = match.search.places.front().pose;
    const ReducedFrame frame = reduce_frame(grey, map_.camera, begin.agl_m, map.gsd_m);
    PoseRefinement refinement(map_.camera, prior, begin, window, map_.surface);
    for (const double inlier_cells : kInlierCells) {
      prior.cancel.check();
      const CameraPose pose = refinement.pose();
      const auto seen = describe_frame(frame, pose, map, map.corner, map_.surface, prior.cancel);
      if (!seen) break;
      const PatchMatches found = match_cells(seen->picture, seen->grid, map);
      if (!refinement.solve(match, found, seen->rectified, pose, inlier_cells * kDescriptorCell_px,
                            kPatch_cells * kDescriptorCell_px)) {
        break;
      }
    }
    if (!match.solved) return;
    match.map_ce90_m =
        reader_.ce90_m(map_.frame, square_around(match.solved->pose.position, plan.reach_m), plan.scale.fine_gsd_m);
  }

  static PatchMatches match_cells(const DescribedPicture& frame, const GroundGrid& grid, const MapCells& map) {
    PatchMatches matches;
    const cv::Point offset = map.cell_of(grid), slack(kPatchSearch_cells, kPatchSearch_cells);
    const cv::Size placements(2 * kPatchSearch_cells + 1, 2 * kPatchSearch_cells + 1);
    for (int r = 0; r + kPatch_cells <= grid.rows; r += kPatchStep_cells) {
      for (int c = 0; c + kPatch_cells <= grid.columns; c += kPatchStep_cells) {
        const cv::Rect patch(c, r, kPatch_cells, kPatch_cells);
        if (cv::countNonZero(frame.mask(patch)) < kPatchMinCovered * patch.area()) continue;
        ++matches.tried;
        const cv::Mat scores =
            cell_scores(frame, patch, map.picture, patch.tl() + offset - slack, placements, kPatchMinValid);
        const Peak peak = best_peak(scores);
        const double last = placements.width - 1.5;
        if (peak.score < kMinPatchScore || peak.x < 0.5 || peak.y < 0.5 || peak.x > last || peak.y > last) continue;
        PatchMatch match;
        match.score = peak.score;
        match.in_frame = grid.plane_from_pixel(c + kPatch_cells / 2.0, r + kPatch_cells / 2.0);
        match.on_map = {match.in_frame.east_m + (peak.x - slack.x) * map.cell_m,
                        match.in_frame.north_m - (peak.y - slack.y) * map.cell_m};
        match.information_m2 = peak_information_m2(scores, peak, map.cell_m);
        if (match.information_m2.allFinite()) matches.found.push_back(match);
      }
    }
    return matches;
  }

  MatcherMap map_;
  std::shared_ptr<DenseDescriptorNetwork> network_;
  DescriptorMatching how_;
  MapWindowReader reader_;
};

}  // namespace

std::unique_ptr<MapMatcher> make_descriptor_matcher(const MatcherMap& map,
                                                    std::shared_ptr<DenseDescriptorNetwork> network,
                                                    const DescriptorMatching& how) {
  return std::make_unique<DescriptorMatcher>(map, std::move(network), how);
}

}  // namespace nadir
