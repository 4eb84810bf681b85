#include "vision/map_search.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <span>
#include <utility>

#include "geodesy/angles.hpp"
#include "vision/correlation.hpp"
#include "vision/matching_plan.hpp"

namespace nadir {
namespace {

struct HeadingAndHeight {
  double heading_rad = 0;
  double agl_m = 0;
};

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

// Camera positions that are searched, as placements of the template's corner in the window's pixels.
cv::Rect searched_part(const MapWindow& map, const GroundGrid& grid, const SearchPrior& prior, cv::Size placements) {
  const double left = (prior.pose.position.east_m - prior.radius_m + grid.west_m - map.west_m) / map.gsd_m;
  const double top = (map.north_m - prior.pose.position.north_m - prior.radius_m - grid.north_m) / map.gsd_m;
  const int side = static_cast<int>(std::ceil(2 * prior.radius_m / map.gsd_m));
  return cv::Rect(static_cast<int>(std::floor(left)), static_cast<int>(std::floor(top)), side, side) &
         cv::Rect(cv::Point(0, 0), placements);
}

PlanePoint camera_of(const MapWindow& map, const GroundGrid& grid, double x, double y) {
  return {map.west_m + x * map.gsd_m - grid.west_m, map.north_m - y * map.gsd_m - grid.north_m};
}

// Patches reach no farther: peaks that are as far apart are not the same.
double near_m(const SearchOptions& options) { return kNearPeak_px * options.gsd_m; }

// The peak is near the place, and is not the place itself.
bool is_near(const MatchHypothesis& peak, const MatchHypothesis& place, const SearchOptions& options) {
  const double off_m = distance_m(peak.pose.position, place.pose.position);
  return off_m >= near_m(options) && off_m < options.distinct_m;
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

std::vector<HeadingAndHeight> around(const HeadingAndHeight& middle, double heading_range, double heading_step,
                                     double scale_range, double scale_step) {
  std::vector<HeadingAndHeight> trials;
  for (const double scale : offsets_within(scale_range, scale_step)) {
    for (const double turn : offsets_within(heading_range, heading_step)) {
      trials.push_back({middle.heading_rad + turn, middle.agl_m * (1 + scale)});
    }
  }
  return trials;
}

HeadingAndHeight trial_of(const MatchHypothesis& hypothesis) {
  return {hypothesis.pose.attitude.heading_rad, hypothesis.pose.agl_m};
}

// The part of the map that a template covers there and up to `slack` pixels off.
cv::Rect part_under(const MapWindow& map, const GroundGrid& grid, PlanePoint camera, int slack) {
  const auto left = static_cast<int>(std::lround((camera.east_m + grid.west_m - map.west_m) / map.gsd_m));
  const auto top = static_cast<int>(std::lround((map.north_m - camera.north_m - grid.north_m) / map.gsd_m));
  return {left - slack, top - slack, grid.columns + 2 * slack, grid.rows + 2 * slack};
}

// Candidates close together lie on the same ground.
void cover_all(MapChannels& channels, const std::vector<MatchHypothesis>& hypotheses, const ReducedFrame& frame,
               const MapWindow& map, int slack) {
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
void confirm(MatchHypothesis& hypothesis, const ReducedFrame& frame, const MapWindow& map, MapChannels& map_channels,
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

// The search of one window. The sweep is at half the resolution: four times fewer pixels, and the confirmation corrects
// it.
struct WindowSearch {
  WindowSearch(const cv::Mat& grey, const CameraModel& camera, const MapWindow& window, const SearchPrior& search_prior,
               const SearchOptions& search_options)
      : prior(search_prior),
        options(search_options),
        map(at_gsd(window, options.gsd_m)),
        frame(reduce_frame(grey, camera, prior.pose.agl_m, map.gsd_m)),
        sweep_map(at_gsd(window, options.gsd_m * kSweepReduction)) {}

  SearchPrior prior;
  SearchOptions options;
  MapWindow map;
  ReducedFrame frame;
  MapWindow sweep_map;
  std::vector<MatchHypothesis> places;
  std::vector<MatchHypothesis> near_best;  // peaks around the best of each heading and scale

  // The frame looks the same in both sweeps.
  bool sweeps_as(const WindowSearch& other) const {
    const CameraPose &one = prior.pose, &two = other.prior.pose;
    return map.gsd_m == other.map.gsd_m && sweep_map.gsd_m == other.sweep_map.gsd_m &&
           sweep_map.image.size() == other.sweep_map.image.size() &&
           one.attitude.heading_rad == two.attitude.heading_rad && one.attitude.pitch_rad == two.attitude.pitch_rad &&
           one.attitude.roll_rad == two.attitude.roll_rad && one.agl_m == two.agl_m &&
           prior.heading_range_rad == other.prior.heading_range_rad && prior.scale_range == other.prior.scale_range;
  }
};

// False on the flank of a higher peak, where only what is near that one was left out.
bool is_maximum(const cv::Mat& scores, const Peak& peak) {
  const cv::Point at(static_cast<int>(std::lround(peak.x)), static_cast<int>(std::lround(peak.y)));
  double highest = 0;
  cv::minMaxLoc(scores(cv::Rect(at.x - 1, at.y - 1, 3, 3) & cv::Rect(cv::Point(), scores.size())), nullptr, &highest);
  return highest <= static_cast<double>(scores.at<float>(at));
}

// Windows of one sweep: each template is rectified and transformed once for all of them.
void sweep(std::span<WindowSearch> windows) {
  const WindowSearch& any = windows.front();
  const SearchOptions& options = any.options;
  const ChannelSet set = options.features.sweep;
  const double gsd_m = any.sweep_map.gsd_m;
  const auto trials = around({any.prior.pose.attitude.heading_rad, any.prior.pose.agl_m}, any.prior.heading_range_rad,
                             options.heading_step_rad, any.prior.scale_range, options.scale_step);
  const ReducedFrame frame = reduce_frame(any.frame.image, any.frame.camera, any.prior.pose.agl_m, gsd_m);
  const auto grid = template_grid(frame.camera, any.prior.pose, trials, gsd_m);
  const cv::Size size = any.sweep_map.image.size();
  if (!grid || grid->columns > size.width || grid->rows > size.height) return;
  const auto seen_under = [&](const HeadingAndHeight& trial) {
    return channels_of(rectify(frame, with(any.prior.pose, trial, {}), *grid), set, options);
  };
  std::vector<WindowSpectra> spectra;
  std::vector<TemplateNorm> norms;
  // The denominator varies little over the sweep: one, from the middle trial, serves all.
  const Channels middle = seen_under(trials[trials.size() / 2]);
  for (const WindowSearch& window : windows) {
    const MapWindow& map = window.sweep_map;
    spectra.emplace_back(oriented_channels(map.image, map.mask, set, options.features.channels),
                         cv::Size(grid->columns, grid->rows));
    norms.emplace_back(middle, spectra.back());
  }
  const auto count_of = [&](const WindowSearch& window) {
    return options.candidates * (window.prior.radius_m > kWideRadius_px * options.gsd_m ? kWideCandidates : 1);
  };
  const auto keep_peaks = [&](WindowSearch& window, const HeadingAndHeight& trial, const cv::Mat& scores) {
    const cv::Rect part = searched_part(window.sweep_map, *grid, window.prior, scores.size());
    if (part.empty()) return;
    const double distinct_px = options.distinct_m / gsd_m;
    const auto keep = [&](const std::vector<Peak>& peaks, cv::Point from, std::vector<MatchHypothesis>& kept) {
      for (const Peak& peak : peaks) {
        MatchHypothesis hypothesis;
        hypothesis.pose =
            with(window.prior.pose, trial, camera_of(window.sweep_map, *grid, peak.x + from.x, peak.y + from.y));
        hypothesis.coarse_score = peak.score;
        kept.push_back(hypothesis);
      }
    };
    const std::vector<Peak> peaks = distinct_peaks(scores(part), count_of(window), distinct_px);
    keep(peaks, part.tl(), window.places);
    if (peaks.empty()) return;
    const int reach = static_cast<int>(std::ceil(distinct_px));
    const cv::Point best(static_cast<int>(std::lround(peaks[0].x)), static_cast<int>(std::lround(peaks[0].y)));
    const cv::Rect near = (cv::Rect(best.x - reach, best.y - reach, 2 * reach + 1, 2 * reach + 1) + part.tl()) & part;
    std::vector<Peak> around = distinct_peaks(scores(near), kNearPeaks + 1, near_m(options) / gsd_m);
    std::erase_if(around, [&](const Peak& peak) { return !is_maximum(scores(near), peak); });
    keep(around, near.tl(), window.near_best);
  };
  for (std::size_t i = 0; i < trials.size(); i += 2) {
    options.cancel.check();
    const bool pair = i + 1 < trials.size();
    const Channels one = seen_under(trials[i]);
    const std::optional<Channels> other = pair ? std::optional(seen_under(trials[i + 1])) : std::nullopt;
    const TemplateSpectra patterns(one, pair ? &*other : nullptr, spectra.front());
    for (std::size_t w = 0; w < windows.size(); ++w) {
      const std::vector<cv::Mat> scores = patterns.scores(spectra[w], norms[w]);
      for (std::size_t k = 0; k < scores.size(); ++k) keep_peaks(windows[w], trials[i + k], scores[k]);
    }
  }
  for (WindowSearch& window : windows) {
    window.places =
        distinct(std::move(window.places), options.distinct_m, &MatchHypothesis::coarse_score, count_of(window));
  }
}

void sort_by_score(std::vector<MatchHypothesis>& hypotheses) {
  std::stable_sort(hypotheses.begin(), hypotheses.end(),
                   [](const MatchHypothesis& one, const MatchHypothesis& other) { return one.score > other.score; });
}

// Of the sweep, around the best of the places that were confirmed.
std::vector<MatchHypothesis> near_peaks(const WindowSearch& window) {
  const SearchOptions& options = window.options;
  std::vector<MatchHypothesis> near;
  for (std::size_t i = 0; i < std::min(kRefinedCandidates, window.places.size()); ++i) {
    const MatchHypothesis& place = window.places[i];
    std::vector<MatchHypothesis> around;
    for (const MatchHypothesis& peak : window.near_best) {
      const bool comparable = peak.coarse_score >= kNearPeakScore * place.coarse_score;
      if (comparable && is_near(peak, place, options)) around.push_back(peak);
    }
    around = distinct(std::move(around), near_m(options), &MatchHypothesis::coarse_score, kNearPeaks);
    near.insert(near.end(), around.begin(), around.end());
  }
  return near;
}

// After the sweep.
SearchResult confirm_places(WindowSearch& window) {
  const SearchOptions& options = window.options;
  std::vector<MatchHypothesis>& places = window.places;
  const int slack = static_cast<int>(std::ceil(2 * window.sweep_map.gsd_m / window.map.gsd_m));
  MapChannels ground(window.map.image, window.map.mask, options.features.fine, options.features.channels);
  cover_all(ground, places, window.frame, window.map, slack);
  const auto confirm_all = [&](std::vector<MatchHypothesis>& hypotheses) {
    for (MatchHypothesis& hypothesis : hypotheses)
      confirm(hypothesis, window.frame, window.map, ground, {trial_of(hypothesis)}, slack, options);
  };
  confirm_all(places);
  sort_by_score(places);
  std::vector<MatchHypothesis> near = near_peaks(window);
  confirm_all(near);
  places.insert(places.end(), near.begin(), near.end());
  sort_by_score(places);
  // The best, what is near it, and its rival elsewhere are compared over the headings and scales between the sweep's
  // steps.
  const auto refine = [&](MatchHypothesis& hypothesis) {
    const double turn = options.heading_step_rad / 2, scale = options.scale_step / 2;
    confirm(hypothesis, window.frame, window.map, ground, around(trial_of(hypothesis), turn, turn, 0, 1),
            kRefineSlack_px, options);
    confirm(hypothesis, window.frame, window.map, ground, around(trial_of(hypothesis), 0, 1, scale, scale),
            kRefineSlack_px, options);
  };
  if (places.empty()) return {};
  const MatchHypothesis best = places.front();
  const auto refine_first = [&](const auto& wanted) {
    const auto found = std::find_if(places.begin(), places.end(), wanted);
    if (found != places.end()) refine(*found);
  };
  refine_first([&](const MatchHypothesis& h) { return is_near(h, best, options); });
  refine_first(
      [&](const MatchHypothesis& h) { return distance_m(h.pose.position, best.pose.position) >= options.distinct_m; });
  refine(places.front());
  return best_of(std::move(places), options);
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

std::vector<double> offsets_within(double range, double step) {
  const int n = std::max(0, static_cast<int>(std::ceil(range / step - 0.5)));
  std::vector<double> values;
  for (int i = -n; i <= n; ++i) values.push_back(i * step);
  return values;
}

SearchResult search_window(const cv::Mat& grey, const CameraModel& camera, const MapWindow& map,
                           const SearchPrior& prior, const SearchOptions& options) {
  std::vector<WindowSearch> windows;
  windows.emplace_back(grey, camera, map, prior, options);
  sweep(windows);
  return confirm_places(windows.front());
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
  std::vector<WindowSearch> together;
  const auto finish = [&] {
    if (!together.empty()) sweep(together);
    for (WindowSearch& window : together) {
      const SearchResult found = confirm_places(window);
      all.places.insert(all.places.end(), found.places.begin(), found.places.end());
    }
    together.clear();
  };
  for (const SearchPrior& search : windows) {
    query.options.cancel.check();
    const MapWindow window =
        query.map.read(query.frame, square_around(search.pose.position, search.radius_m + query.reach_m),
                       query.options.gsd_m, Colour::grey);
    if (cv::countNonZero(window.mask) == 0) continue;
    all.on_map = true;
    WindowSearch next(query.grey, query.camera, cropped_to_map(window, query.reach_m / 2), search, query.options);
    if (together.size() == kSweptTogether || (!together.empty() && !next.sweeps_as(together.front()))) finish();
    together.push_back(std::move(next));
  }
  finish();
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
