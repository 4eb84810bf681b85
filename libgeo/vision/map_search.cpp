#include "vision/map_search.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "geodesy/angles.hpp"
#include "vision/correlation.hpp"
#include "vision/matching_plan.hpp"

namespace nadir {
namespace {

struct HeadingAndHeight {
  double heading_rad = 0;
  double agl_m = 0;
};

// Offsets that cover ±range, each standing for half a step to both sides.
std::vector<double> steps(double range, double step) {
  const int n = std::max(0, static_cast<int>(std::ceil(range / step - 0.5)));
  std::vector<double> values;
  for (int i = -n; i <= n; ++i) values.push_back(i * step);
  return values;
}

CameraPose with(const CameraPose& pose, const HeadingAndHeight& trial, PlanePoint position) {
  CameraPose result = pose;
  result.attitude.heading_rad = trial.heading_rad;
  result.agl_m = trial.agl_m;
  result.position = position;
  return result;
}

// The smallest grid around the footprints of all headings and heights, relative to the ground point under the camera at
// (0, 0).
std::optional<GroundGrid> template_grid(const CameraModel& camera, const CameraPose& pose,
                                        const std::vector<HeadingAndHeight>& trials, double gsd_m) {
  std::optional<PlaneBox> all;
  for (const HeadingAndHeight& trial : trials) {
    const auto box = footprint_of(camera, with(pose, trial, {}));
    if (!box) return std::nullopt;
    if (!all) all = box;
    all->west_m = std::min(all->west_m, box->west_m);
    all->south_m = std::min(all->south_m, box->south_m);
    all->east_m = std::max(all->east_m, box->east_m);
    all->north_m = std::max(all->north_m, box->north_m);
  }
  if (!all) return std::nullopt;
  GroundGrid grid;
  grid.gsd_m = gsd_m;
  grid.west_m = std::floor(all->west_m / gsd_m) * gsd_m;
  grid.north_m = std::ceil(all->north_m / gsd_m) * gsd_m;
  grid.columns = static_cast<int>(std::ceil((all->east_m - grid.west_m) / gsd_m));
  grid.rows = static_cast<int>(std::ceil((grid.north_m - all->south_m) / gsd_m));
  return grid;
}

Channels channels_of(const RectifiedFrame& frame, ChannelSet set, const SearchOptions& options) {
  return oriented_channels(frame.image, frame.mask, set, options.features.channels);
}

struct ScaledMap {
  cv::Mat image, mask;
  double west_m, north_m, gsd_m;
};

ScaledMap shrink(const MapWindow& map, double gsd_m) {
  const double factor = map.gsd_m / gsd_m;
  if (factor > kWorthShrinking) return {map.image, map.mask, map.west_m, map.north_m, map.gsd_m};
  const cv::Size size(static_cast<int>(std::lround(map.image.cols * factor)),
                      static_cast<int>(std::lround(map.image.rows * factor)));
  ScaledMap scaled{{}, {}, map.west_m, map.north_m, gsd_m};
  cv::resize(map.image, scaled.image, size, 0, 0, cv::INTER_AREA);
  cv::resize(map.mask, scaled.mask, size, 0, 0, cv::INTER_AREA);
  cv::threshold(scaled.mask, scaled.mask, 254, 255, cv::THRESH_BINARY);
  scaled.gsd_m = map.gsd_m * map.image.cols / size.width;
  return scaled;
}

// Camera positions that are searched, as placements of the template's corner in the window's pixels.
cv::Rect searched_part(const ScaledMap& map, const GroundGrid& grid, const SearchPrior& prior, cv::Size placements) {
  const double left = (prior.pose.position.east_m - prior.radius_m + grid.west_m - map.west_m) / map.gsd_m;
  const double top = (map.north_m - prior.pose.position.north_m - prior.radius_m - grid.north_m) / map.gsd_m;
  const int side = static_cast<int>(std::ceil(2 * prior.radius_m / map.gsd_m));
  return cv::Rect(static_cast<int>(std::floor(left)), static_cast<int>(std::floor(top)), side, side) &
         cv::Rect(cv::Point(0, 0), placements);
}

PlanePoint camera_of(const ScaledMap& map, const GroundGrid& grid, double x, double y) {
  return {map.west_m + x * map.gsd_m - grid.west_m, map.north_m - y * map.gsd_m - grid.north_m};
}

// Keeps the best of the hypotheses that are one place.
std::vector<MatchHypothesis> distinct(std::vector<MatchHypothesis> hypotheses, double distinct_m,
                                      double MatchHypothesis::*score, std::size_t count) {
  std::stable_sort(hypotheses.begin(), hypotheses.end(),
                   [score](const MatchHypothesis& a, const MatchHypothesis& b) { return a.*score > b.*score; });
  std::vector<MatchHypothesis> kept;
  for (const MatchHypothesis& hypothesis : hypotheses) {
    const bool known = std::any_of(kept.begin(), kept.end(), [&](const MatchHypothesis& other) {
      return distance_m(other.pose.position, hypothesis.pose.position) < distinct_m;
    });
    if (!known) kept.push_back(hypothesis);
    if (kept.size() == count) break;
  }
  return kept;
}

std::vector<MatchHypothesis> sweep(const ReducedFrame& frame, const ScaledMap& map, const SearchPrior& prior,
                                   const std::vector<HeadingAndHeight>& trials, const SearchOptions& options,
                                   std::size_t count) {
  const ChannelSet set = options.features.sweep;
  const auto grid = template_grid(frame.camera, prior.pose, trials, map.gsd_m);
  if (!grid || grid->columns > map.image.cols || grid->rows > map.image.rows) return {};
  const WindowSpectra window(oriented_channels(map.image, map.mask, set, options.features.channels),
                             {grid->columns, grid->rows});
  const auto seen_under = [&](const HeadingAndHeight& trial) {
    return channels_of(rectify(frame, with(prior.pose, trial, {}), *grid), set, options);
  };
  // The denominator varies little over the sweep: one, from the middle trial, serves all.
  const TemplateNorm norm(seen_under(trials[trials.size() / 2]), window);
  std::vector<MatchHypothesis> hypotheses;
  const auto keep_peaks = [&](const HeadingAndHeight& trial, const cv::Mat& scores) {
    const cv::Rect part = searched_part(map, *grid, prior, scores.size());
    if (part.empty()) return;
    for (const Peak& peak : distinct_peaks(scores(part), count, options.distinct_m / map.gsd_m)) {
      MatchHypothesis hypothesis;
      hypothesis.pose = with(prior.pose, trial, camera_of(map, *grid, peak.x + part.x, peak.y + part.y));
      hypothesis.coarse_score = peak.score;
      hypotheses.push_back(hypothesis);
    }
  };
  for (std::size_t i = 0; i < trials.size(); i += 2) {
    options.cancel.check();
    if (i + 1 == trials.size()) {
      keep_peaks(trials[i], correlate(seen_under(trials[i]), window, norm));
    } else {
      const auto [one, other] = correlate(seen_under(trials[i]), seen_under(trials[i + 1]), window, norm);
      keep_peaks(trials[i], one);
      keep_peaks(trials[i + 1], other);
    }
  }
  return distinct(std::move(hypotheses), options.distinct_m, &MatchHypothesis::coarse_score, count);
}

HeadingAndHeight trial_of(const MatchHypothesis& hypothesis) {
  return {hypothesis.pose.attitude.heading_rad, hypothesis.pose.agl_m};
}

// The part of the map that a template covers there and up to `slack` pixels off.
cv::Rect part_under(const ScaledMap& map, const GroundGrid& grid, PlanePoint camera, int slack) {
  const auto left = static_cast<int>(std::lround((camera.east_m + grid.west_m - map.west_m) / map.gsd_m));
  const auto top = static_cast<int>(std::lround((map.north_m - camera.north_m - grid.north_m) / map.gsd_m));
  return {left - slack, top - slack, grid.columns + 2 * slack, grid.rows + 2 * slack};
}

// Candidates close together lie on the same ground.
void cover_all(MapChannels& channels, const std::vector<MatchHypothesis>& hypotheses, const ReducedFrame& frame,
               const ScaledMap& map, int slack) {
  cv::Rect all;
  int single = 0;
  for (const MatchHypothesis& hypothesis : hypotheses) {
    const auto grid = template_grid(frame.camera, hypothesis.pose, {trial_of(hypothesis)}, map.gsd_m);
    if (!grid) continue;
    const cv::Rect part = part_under(map, *grid, hypothesis.pose.position, slack);
    all |= part;
    single += part.area();
  }
  if (all.area() < single) channels.cover(all);
}

// The best pose near a candidate, with all channels.
void confirm(MatchHypothesis& hypothesis, const ReducedFrame& frame, const ScaledMap& map, MapChannels& map_channels,
             const std::vector<HeadingAndHeight>& trials, int slack, const SearchOptions& options) {
  const ChannelSet set = options.features.fine;
  const auto grid = template_grid(frame.camera, hypothesis.pose, trials, map.gsd_m);
  if (!grid) return;
  const cv::Rect part = part_under(map, *grid, hypothesis.pose.position, slack);
  if ((part & cv::Rect(cv::Point(), map.image.size())).empty()) return;
  map_channels.cover(part);
  const CameraPose begin = hypothesis.pose;
  const bool confirmed = hypothesis.score > -1;
  for (const HeadingAndHeight& trial : trials) {
    options.cancel.check();
    if (confirmed && trial.heading_rad == begin.attitude.heading_rad && trial.agl_m == begin.agl_m)
      continue;  // is known
    const RectifiedFrame rectified = rectify(frame, with(begin, trial, {}), *grid);
    const QuantizedChannels whole = quantized_channels(rectified.image, rectified.mask, set, options.features.channels);
    const LocalTemplate pattern(whole, cv::Rect(cv::Point(), whole.size()));
    const Peak peak = best_peak(
        pattern.scores(map_channels.channels(), map_channels.inside(part.tl()), {2 * slack + 1, 2 * slack + 1}));
    if (peak.score <= hypothesis.score) continue;
    hypothesis.score = peak.score;
    hypothesis.pose = with(begin, trial,
                           {map.west_m + (part.x + peak.x) * map.gsd_m - grid->west_m,
                            map.north_m - (part.y + peak.y) * map.gsd_m - grid->north_m});
  }
}

std::vector<HeadingAndHeight> around(const HeadingAndHeight& middle, double heading_range, double heading_step,
                                     double scale_range, double scale_step) {
  std::vector<HeadingAndHeight> trials;
  for (const double scale : steps(scale_range, scale_step)) {
    for (const double turn : steps(heading_range, heading_step)) {
      trials.push_back({middle.heading_rad + turn, middle.agl_m * (1 + scale)});
    }
  }
  return trials;
}

// The frame north-up, around the ground point under the camera.
std::optional<RectifiedFrame> upright(const AreaQuery& query) {
  CameraPose pose = query.prior.pose;
  pose.position = {};
  const auto box = footprint_of(query.camera, pose);
  if (!box) return std::nullopt;
  GroundGrid grid;
  grid.gsd_m = query.options.gsd_m;
  grid.west_m = box->west_m;
  grid.north_m = box->north_m;
  grid.columns = static_cast<int>(std::ceil((box->east_m - box->west_m) / grid.gsd_m));
  grid.rows = static_cast<int>(std::ceil((box->north_m - box->south_m) / grid.gsd_m));
  return rectify(reduce_frame(query.grey, query.camera, pose.agl_m, grid.gsd_m), pose, grid);
}

bool inside(const PlaneBox& box, PlanePoint point, double margin_m) {
  return point.east_m >= box.west_m - margin_m && point.east_m <= box.east_m + margin_m &&
         point.north_m >= box.south_m - margin_m && point.north_m <= box.north_m + margin_m;
}

bool same_place(const SearchPrior& one, const SearchPrior& other) {
  const double off_m = distance_m(one.pose.position, other.pose.position);
  const double turn_rad = wrap_pi(one.pose.attitude.heading_rad - other.pose.attitude.heading_rad);
  return off_m < one.radius_m && std::abs(turn_rad) < one.heading_range_rad;
}

// Windows around the `count` places that look most like the frame; none when none of them lie in the area.
std::vector<SearchPrior> retrieved_windows(const AreaQuery& query, const PlaceRetrieval& retrieval,
                                           const PlaneBox& area, std::size_t count) {
  const auto image = upright(query);
  if (!image) return {};
  const SearchPrior& prior = query.prior;
  const bool any_heading = prior.heading_range_rad >= kPi;
  PlaceQuery place_query{image->image, image->mask, image->grid.gsd_m, std::nullopt, query.options.cancel};
  if (!any_heading) place_query.heading_range_rad = prior.heading_range_rad;
  const PlanePoint middle = image->grid.plane_from_pixel(image->grid.columns / 2.0, image->grid.rows / 2.0);

  std::vector<SearchPrior> windows;
  for (const PlaceCandidate& candidate : retrieval.query(place_query, count * kChunksPerPlace)) {
    const PlanePoint chunk = query.frame.plane_from_lonlat(candidate.centre);
    const double turn = candidate.turn_rad;
    SearchPrior window = prior;
    window.pose.attitude.heading_rad = wrap_pi(prior.pose.attitude.heading_rad + turn);
    // The ground point under the camera lies off the image's middle, on a side that turns with the heading (clockwise).
    window.pose.position = {
        chunk.east_m + candidate.offset_m.x() - (std::cos(turn) * middle.east_m + std::sin(turn) * middle.north_m),
        chunk.north_m + candidate.offset_m.y() - (std::cos(turn) * middle.north_m - std::sin(turn) * middle.east_m)};
    window.radius_m = kRetrievedReach * candidate.side_m;
    window.heading_range_rad = std::min(prior.heading_range_rad, any_heading ? kUnknownTurn_rad : kKnownTurn_rad);
    if (!inside(area, window.pose.position, window.radius_m)) continue;
    const bool known = std::any_of(windows.begin(), windows.end(),
                                   [&](const SearchPrior& other) { return same_place(other, window); });
    if (!known) windows.push_back(window);
    if (windows.size() == count) break;
  }
  return windows;
}

}  // namespace

SearchResult search_window(const cv::Mat& grey, const CameraModel& camera, const MapWindow& map,
                           const SearchPrior& prior, const SearchOptions& options) {
  const HeadingAndHeight middle{prior.pose.attitude.heading_rad, prior.pose.agl_m};
  const auto wide =
      around(middle, prior.heading_range_rad, options.heading_step_rad, prior.scale_range, options.scale_step);
  const ScaledMap confirm_map = shrink(map, options.gsd_m);
  const ReducedFrame frame = reduce_frame(grey, camera, prior.pose.agl_m, confirm_map.gsd_m);
  // Swept at half the resolution: four times fewer pixels, and the confirmation corrects it.
  const ScaledMap sweep_map = shrink(map, options.gsd_m * kSweepReduction);
  const bool wide_window = prior.radius_m > kWideRadius_px * options.gsd_m;

  SearchResult result;
  result.places = sweep(reduce_frame(frame.image, frame.camera, prior.pose.agl_m, sweep_map.gsd_m), sweep_map, prior,
                        wide, options, options.candidates * (wide_window ? kWideCandidates : 1));
  const int slack = static_cast<int>(std::ceil(2 * sweep_map.gsd_m / confirm_map.gsd_m));
  MapChannels ground(confirm_map.image, confirm_map.mask, options.features.fine, options.features.channels);
  cover_all(ground, result.places, frame, confirm_map, slack);
  for (MatchHypothesis& hypothesis : result.places)
    confirm(hypothesis, frame, confirm_map, ground, {trial_of(hypothesis)}, slack, options);
  // The two best are compared over the headings and scales between the sweep's steps.
  std::stable_sort(result.places.begin(), result.places.end(),
                   [](const MatchHypothesis& one, const MatchHypothesis& other) { return one.score > other.score; });
  for (std::size_t i = 0; i < std::min(kRefinedCandidates, result.places.size()); ++i) {
    MatchHypothesis& hypothesis = result.places[i];
    const double turn = options.heading_step_rad / 2, scale = options.scale_step / 2;
    confirm(hypothesis, frame, confirm_map, ground, around(trial_of(hypothesis), turn, turn, 0, 1), kRefineSlack_px,
            options);
    confirm(hypothesis, frame, confirm_map, ground, around(trial_of(hypothesis), 0, 1, scale, scale), kRefineSlack_px,
            options);
  }
  return best_of(std::move(result.places), options);
}

SearchResult best_of(std::vector<MatchHypothesis> hypotheses, const SearchOptions& options) {
  SearchResult result;
  result.places = distinct(std::move(hypotheses), options.distinct_m, &MatchHypothesis::score, options.candidates);
  if (result.places.size() >= 2 && result.places[0].score > 0) {
    result.ratio = std::max(0.0, result.places[1].score) / result.places[0].score;
  }
  return result;
}

AreaHypotheses search_windows(const AreaQuery& query, const std::vector<SearchPrior>& windows) {
  AreaHypotheses all;
  for (const SearchPrior& search : windows) {
    query.options.cancel.check();
    const PlanePoint middle = search.pose.position;
    const double half_m = search.radius_m + query.reach_m;
    const MapWindow window = query.map.read(
        query.frame, {middle.east_m - half_m, middle.north_m - half_m, middle.east_m + half_m, middle.north_m + half_m},
        query.options.gsd_m, Colour::grey);
    if (cv::countNonZero(window.mask) == 0) continue;
    all.on_map = true;
    const SearchResult found =
        search_window(query.grey, query.camera, cropped_to_map(window, query.reach_m / 2), search, query.options);
    all.places.insert(all.places.end(), found.places.begin(), found.places.end());
  }
  return all;
}

AreaHypotheses search_retrieved(const AreaQuery& query, const PlaceRetrieval& retrieval, const PlaneBox& area,
                                std::size_t count) {
  AreaQuery narrow = query;
  narrow.options.candidates = kFewCandidates;
  return search_windows(narrow, retrieved_windows(query, retrieval, area, count));
}

std::vector<MatchHypothesis> rivals(const AreaQuery& query, const PlaneBox& area, const MatchHypothesis& found) {
  AreaQuery narrow = query;
  narrow.prior.pose.attitude.heading_rad = found.pose.attitude.heading_rad;
  narrow.prior.pose.agl_m = found.pose.agl_m;
  narrow.prior.heading_range_rad = 0;
  narrow.prior.scale_range = 0;
  narrow.options.candidates = kFewCandidates;
  return search_windows(narrow, windows_over(area, narrow.prior)).places;
}

}  // namespace nadir
