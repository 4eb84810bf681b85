#include "vision/place_search.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "vision/correlation.hpp"
#include "vision/map_channels.hpp"
#include "vision/near_correlation.hpp"

namespace nadir {
namespace {

constexpr double kWideRadius_px = 190;  // has more places that look alike

struct Hypothesis {
  double heading_rad = 0;
  double agl_m = 0;
};

// Offsets that cover ±range when each one serves half a step to both sides.
std::vector<double> steps(double range, double step) {
  const int n = std::max(0, static_cast<int>(std::ceil(range / step - 0.5)));
  std::vector<double> values;
  for (int i = -n; i <= n; ++i) values.push_back(i * step);
  return values;
}

CameraPose with(const CameraPose& pose, const Hypothesis& hypothesis, PlanePoint position) {
  CameraPose result = pose;
  result.attitude.heading_rad = hypothesis.heading_rad;
  result.agl_m = hypothesis.agl_m;
  result.position = position;
  return result;
}

// The smallest grid around the footprint that all hypotheses share, relative to the camera's foot point at (0, 0).
std::optional<GroundGrid> template_grid(const CameraModel& camera, const CameraPose& pose,
                                        const std::vector<Hypothesis>& hypotheses, double gsd_m) {
  std::optional<PlaneBox> all;
  for (const Hypothesis& hypothesis : hypotheses) {
    const auto box = footprint_of(camera, with(pose, hypothesis, {}));
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
  return oriented_channels(frame.image, frame.mask, set, options.likeness.channels);
}

struct ScaledMap {
  cv::Mat image, mask;
  double west_m, north_m, gsd_m;
};

ScaledMap shrink(const MapWindow& map, double gsd_m) {
  const double factor = map.gsd_m / gsd_m;
  if (factor > 0.95) return {map.image, map.mask, map.west_m, map.north_m, map.gsd_m};
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

double distance_m(PlanePoint a, PlanePoint b) { return std::hypot(a.east_m - b.east_m, a.north_m - b.north_m); }

// Keeps the best of places that are one place.
std::vector<Place> distinct(std::vector<Place> places, double distinct_m, double Place::*score, std::size_t count) {
  std::stable_sort(places.begin(), places.end(),
                   [score](const Place& a, const Place& b) { return a.*score > b.*score; });
  std::vector<Place> kept;
  for (const Place& place : places) {
    const bool known = std::any_of(kept.begin(), kept.end(), [&](const Place& other) {
      return distance_m(other.pose.position, place.pose.position) < distinct_m;
    });
    if (!known) kept.push_back(place);
    if (kept.size() == count) break;
  }
  return kept;
}

std::vector<Place> sweep(const ReducedFrame& frame, const ScaledMap& map, const SearchPrior& prior,
                         const std::vector<Hypothesis>& hypotheses, const SearchOptions& options, std::size_t count) {
  const ChannelSet set = options.likeness.sweep;
  const auto grid = template_grid(frame.camera, prior.pose, hypotheses, map.gsd_m);
  if (!grid || grid->columns > map.image.cols || grid->rows > map.image.rows) return {};
  const WindowSpectra window(oriented_channels(map.image, map.mask, set, options.likeness.channels));
  // The denominator varies little over the sweep: one, from the middle hypothesis, serves all.
  const Hypothesis middle = hypotheses[hypotheses.size() / 2];
  const TemplateNorm norm(channels_of(rectify(frame, with(prior.pose, middle, {}), *grid), set, options), window);
  std::vector<Place> places;
  for (const Hypothesis& hypothesis : hypotheses) {
    options.cancel.check();
    const RectifiedFrame rectified = rectify(frame, with(prior.pose, hypothesis, {}), *grid);
    const cv::Mat scores = correlate(channels_of(rectified, set, options), window, norm);
    const cv::Rect part = searched_part(map, *grid, prior, scores.size());
    if (part.empty()) continue;
    for (const Peak& peak : distinct_peaks(scores(part), count, options.distinct_m / map.gsd_m)) {
      Place place;
      place.pose = with(prior.pose, hypothesis, camera_of(map, *grid, peak.x + part.x, peak.y + part.y));
      place.coarse_score = peak.score;
      places.push_back(place);
    }
  }
  return distinct(std::move(places), options.distinct_m, &Place::coarse_score, count);
}

Hypothesis hypothesis_of(const Place& place) { return {place.pose.attitude.heading_rad, place.pose.agl_m}; }

// The part of the map that a template covers there and up to `slack` pixels off.
cv::Rect part_under(const ScaledMap& map, const GroundGrid& grid, PlanePoint camera, int slack) {
  const auto left = static_cast<int>(std::lround((camera.east_m + grid.west_m - map.west_m) / map.gsd_m));
  const auto top = static_cast<int>(std::lround((map.north_m - camera.north_m - grid.north_m) / map.gsd_m));
  return {left - slack, top - slack, grid.columns + 2 * slack, grid.rows + 2 * slack};
}

// Candidates close together lie on the same ground.
void cover_all(MapChannels& channels, const std::vector<Place>& places, const ReducedFrame& frame, const ScaledMap& map,
               int slack) {
  cv::Rect all;
  int single = 0;
  for (const Place& place : places) {
    const auto grid = template_grid(frame.camera, place.pose, {hypothesis_of(place)}, map.gsd_m);
    if (!grid) continue;
    const cv::Rect part = part_under(map, *grid, place.pose.position, slack);
    all |= part;
    single += part.area();
  }
  if (all.area() < single) channels.cover(all);
}

// The best pose near a candidate, with all channels.
void confirm(Place& place, const ReducedFrame& frame, const ScaledMap& map, MapChannels& map_channels,
             const std::vector<Hypothesis>& hypotheses, int slack, const SearchOptions& options) {
  const ChannelSet set = options.likeness.fine;
  const auto grid = template_grid(frame.camera, place.pose, hypotheses, map.gsd_m);
  if (!grid) return;
  const cv::Rect part = part_under(map, *grid, place.pose.position, slack);
  if ((part & cv::Rect(cv::Point(), map.image.size())).empty()) return;
  map_channels.cover(part);
  const CameraPose begin = place.pose;
  for (const Hypothesis& hypothesis : hypotheses) {
    options.cancel.check();
    const QuantizedChannels whole(channels_of(rectify(frame, with(begin, hypothesis, {}), *grid), set, options));
    const LocalTemplate pattern(whole, cv::Rect(cv::Point(), whole.size()));
    const Peak peak = best_peak(
        pattern.scores(map_channels.channels(), map_channels.inside(part.tl()), {2 * slack + 1, 2 * slack + 1}));
    if (peak.score <= place.score) continue;
    place.score = peak.score;
    place.pose = with(begin, hypothesis,
                      {map.west_m + (part.x + peak.x) * map.gsd_m - grid->west_m,
                       map.north_m - (part.y + peak.y) * map.gsd_m - grid->north_m});
  }
}

std::vector<Hypothesis> around(const Hypothesis& middle, double heading_range, double heading_step, double scale_range,
                               double scale_step) {
  std::vector<Hypothesis> hypotheses;
  for (const double scale : steps(scale_range, scale_step)) {
    for (const double turn : steps(heading_range, heading_step)) {
      hypotheses.push_back({middle.heading_rad + turn, middle.agl_m * (1 + scale)});
    }
  }
  return hypotheses;
}

}  // namespace

SearchResult search_place(const cv::Mat& grey, const CameraModel& camera, const MapWindow& map,
                          const SearchPrior& prior, const SearchOptions& options) {
  const Hypothesis middle{prior.pose.attitude.heading_rad, prior.pose.agl_m};
  const auto wide =
      around(middle, prior.heading_range_rad, options.heading_step_rad, prior.scale_range, options.scale_step);
  const ScaledMap confirm_map = shrink(map, options.gsd_m);
  const ReducedFrame frame = reduce_frame(grey, camera, prior.pose.agl_m, confirm_map.gsd_m);
  // Swept at half the resolution: four times fewer pixels, and the confirmation sorts it out.
  const ScaledMap sweep_map = shrink(map, options.gsd_m * 2);
  const bool wide_window = prior.radius_m > kWideRadius_px * options.gsd_m;

  SearchResult result;
  result.places = sweep(reduce_frame(frame.image, frame.camera, prior.pose.agl_m, sweep_map.gsd_m), sweep_map, prior,
                        wide, options, options.candidates * (wide_window ? 2 : 1));
  const int slack = static_cast<int>(std::ceil(2 * sweep_map.gsd_m / confirm_map.gsd_m)), near = 2;
  MapChannels ground(confirm_map.image, confirm_map.mask, options.likeness.fine, options.likeness.channels);
  cover_all(ground, result.places, frame, confirm_map, slack);
  for (Place& place : result.places) confirm(place, frame, confirm_map, ground, {hypothesis_of(place)}, slack, options);
  // The two best fight it out over the headings and scales between the sweep's steps.
  std::stable_sort(result.places.begin(), result.places.end(),
                   [](const Place& one, const Place& other) { return one.score > other.score; });
  for (std::size_t i = 0; i < std::min<std::size_t>(2, result.places.size()); ++i) {
    Place& place = result.places[i];
    const double turn = options.heading_step_rad / 2, scale = options.scale_step / 2;
    confirm(place, frame, confirm_map, ground, around(hypothesis_of(place), turn, turn, 0, 1), near, options);
    confirm(place, frame, confirm_map, ground, around(hypothesis_of(place), 0, 1, scale, scale), near, options);
  }
  return best_of(std::move(result.places), options);
}

SearchResult best_of(std::vector<Place> places, const SearchOptions& options) {
  SearchResult result;
  result.places = distinct(std::move(places), options.distinct_m, &Place::score, options.candidates);
  if (result.places.size() >= 2 && result.places[0].score > 0) {
    result.ratio = std::max(0.0, result.places[1].score) / result.places[0].score;
  }
  return result;
}

}  // namespace nadir
