#include "vision/area_search.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "geodesy/angles.hpp"
#include "vision/matching_plan.hpp"

namespace nadir {
namespace {

constexpr std::size_t kChunksPerPlace = 8;  // neighbouring chunks overlap, and all of them look like the place
// Of a chunk's side: how far off a remembered place may be. The memory is good to a sixth, and a picture is not as
// large as the chunk.
constexpr double kRememberedReach = 0.35;
constexpr std::size_t kFewCandidates = 2;  // of a window, where its one place or its best rival is asked for
constexpr double kKnownTurn_rad = 0.12;    // half of the memory's step of headings, and some more …
constexpr double kUnknownTurn_rad = 0.17;  // … where it tries all

// The frame north-up, around the camera's foot point.
std::optional<RectifiedFrame> upright(const AreaQuestion& question) {
  CameraPose pose = question.prior.pose;
  pose.position = {};
  const auto box = footprint_of(question.camera, pose);
  if (!box) return std::nullopt;
  GroundGrid grid;
  grid.gsd_m = question.options.gsd_m;
  grid.west_m = box->west_m;
  grid.north_m = box->north_m;
  grid.columns = static_cast<int>(std::ceil((box->east_m - box->west_m) / grid.gsd_m));
  grid.rows = static_cast<int>(std::ceil((box->north_m - box->south_m) / grid.gsd_m));
  return rectify(reduce_frame(question.grey, question.camera, pose.agl_m, grid.gsd_m), pose, grid);
}

bool inside(const PlaneBox& box, PlanePoint point, double slack_m) {
  return point.east_m >= box.west_m - slack_m && point.east_m <= box.east_m + slack_m &&
         point.north_m >= box.south_m - slack_m && point.north_m <= box.north_m + slack_m;
}

bool same_place(const SearchPrior& one, const SearchPrior& other) {
  const double off_m = std::hypot(one.pose.position.east_m - other.pose.position.east_m,
                                  one.pose.position.north_m - other.pose.position.north_m);
  const double turn_rad = wrap_pi(one.pose.attitude.heading_rad - other.pose.attitude.heading_rad);
  return off_m < one.radius_m && std::abs(turn_rad) < one.heading_range_rad;
}

// Windows around the `count` places that look most like the frame; none when the memory knows none in the area.
std::vector<SearchPrior> remembered_windows(const AreaQuestion& question, const PlaceRetrieval& memory,
                                            const PlaneBox& area, std::size_t count) {
  const auto picture = upright(question);
  if (!picture) return {};
  const SearchPrior& prior = question.prior;
  const bool any_heading = prior.heading_range_rad >= kPi;
  PlaceQuery query{picture->image, picture->mask, picture->grid.gsd_m, std::nullopt, question.options.cancel};
  if (!any_heading) query.heading_range_rad = prior.heading_range_rad;
  const PlanePoint middle = picture->grid.plane_from_pixel(picture->grid.columns / 2.0, picture->grid.rows / 2.0);

  std::vector<SearchPrior> windows;
  for (const PlaceCandidate& candidate : memory.query(query, count * kChunksPerPlace)) {
    const Enu chunk = question.frame.enu_from_lonlat(candidate.centre);
    const double turn = candidate.turn_rad;
    SearchPrior window = prior;
    window.pose.attitude.heading_rad = wrap_pi(prior.pose.attitude.heading_rad + turn);
    // The camera's foot point lies off the picture's middle, on a side that turns with the heading (clockwise).
    window.pose.position = {
        chunk.east_m + candidate.east_m - (std::cos(turn) * middle.east_m + std::sin(turn) * middle.north_m),
        chunk.north_m + candidate.north_m - (std::cos(turn) * middle.north_m - std::sin(turn) * middle.east_m)};
    window.radius_m = kRememberedReach * candidate.side_m;
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

AreaAnswer search_windows(const AreaQuestion& question, const std::vector<SearchPrior>& windows) {
  AreaAnswer answer;
  for (const SearchPrior& search : windows) {
    question.options.cancel.check();
    const PlanePoint middle = search.pose.position;
    const double half_m = search.radius_m + question.reach_m;
    const MapWindow window = question.map.read(
        question.frame,
        {middle.east_m - half_m, middle.north_m - half_m, middle.east_m + half_m, middle.north_m + half_m},
        question.options.gsd_m, Colour::grey);
    if (cv::countNonZero(window.mask) == 0) continue;
    answer.on_map = true;
    const SearchResult found = search_place(question.grey, question.camera,
                                            cropped_to_map(window, question.reach_m / 2), search, question.options);
    answer.places.insert(answer.places.end(), found.places.begin(), found.places.end());
  }
  return answer;
}

AreaAnswer search_remembered(const AreaQuestion& question, const PlaceRetrieval& memory, const PlaneBox& area,
                             std::size_t count) {
  AreaQuestion narrow = question;
  narrow.options.candidates = kFewCandidates;
  return search_windows(narrow, remembered_windows(question, memory, area, count));
}

std::vector<Place> rivals(const AreaQuestion& question, const PlaneBox& area, const Place& found) {
  AreaQuestion narrow = question;
  narrow.prior.pose.attitude.heading_rad = found.pose.attitude.heading_rad;
  narrow.prior.pose.agl_m = found.pose.agl_m;
  narrow.prior.heading_range_rad = 0;
  narrow.prior.scale_range = 0;
  narrow.options.candidates = kFewCandidates;
  return search_windows(narrow, windows_over(area, narrow.prior)).places;
}

}  // namespace nadir
