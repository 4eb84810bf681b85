// Recall of place retrieval over real imagery of two dates, headings unknown: how often does one of the K best of all
// chunks of a map show the ground that a picture of another day shows? For every descriptor that there is, over the
// same pictures, so that another one can be compared: a PlaceDescriber (datasets/place_gallery.hpp) and a line in
// describers().
//
// The map of a ground (look_grounds.hpp) is cut into squares of the size of the picture, overlapping by three quarters,
// as `nadir cache index` does. Pictures are squares of the other date's image, anywhere on it and turned by any angle;
// of recorded flights, the frames, rectified. A hit: the ground in the picture's middle lies inside the square.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "datasets/place_gallery.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "look_grounds.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/rectification.hpp"

namespace nadir::bench {
namespace {

constexpr int kOverlaps = 4;        // squares in a row that show one place: an overlap of three quarters
constexpr double kUsualSide = 0.9;  // of a picture, over the height above ground
constexpr double kLeastValid = 0.6;
constexpr std::array<std::size_t, 3> kAt{1, 5, 20};

std::vector<std::unique_ptr<PlaceDescriber>> describers() {
  std::vector<std::unique_ptr<PlaceDescriber>> all;
  all.push_back(make_gradient_describer());
  all.push_back(make_projected_gradient_describer());
  return all;
}

struct Query {
  PlaceView view;
  cv::Point2d place;  // in pixels of the map
};

cv::Mat grey_of(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

// The squares of a map, and where their middles lie in it.
struct Squares {
  std::vector<PlacePatch> patches;
  std::vector<cv::Point2d> middles;
  double side_px = 0;  // in pixels of the map
};

Squares squares_of(const cv::Mat& map, double side_px) {
  Squares squares;
  squares.side_px = side_px;
  const cv::Mat grey = grey_of(map), all(map.size(), CV_8UC1, cv::Scalar(255));
  const double scale = side_px / kPlacePatch_px, stride = side_px / kOverlaps;
  const PatchCutter cutter(grey, all, scale);
  for (double y = side_px / 2; y <= map.rows - side_px / 2; y += stride) {
    for (double x = side_px / 2; x <= map.cols - side_px / 2; x += stride) {
      squares.patches.push_back(cutter.cut({.centre = {x, y}, .turn_rad = 0, .pixels_per_px = scale, .shift_px = {}}));
      squares.middles.emplace_back(x, y);
    }
  }
  return squares;
}

double side_of(const Ground& ground) {
  if (!ground.frames.empty()) {
    const CameraModel& camera = ground.camera.camera;
    const double agl_m = ground.frames[ground.frames.size() / 2].agl_m;
    return agl_m * std::sqrt(camera.width / camera.fx * camera.height / camera.fy) / ground.map_gsd_m;
  }
  const double middle_m = std::sqrt(ground.least_agl_m * ground.largest_agl_m) * kUsualSide;
  const double room_px = std::min(ground.map_image.cols, ground.map_image.rows);
  return std::min(middle_m / ground.map_gsd_m, room_px / 4);
}

// Anywhere on the other date's image, which lies on the map pixel by pixel, turned by any angle.
std::vector<Query> drawn_queries(const Ground& ground, double side_px, int count, Random random) {
  const cv::Mat grey = grey_of(ground.picture);
  const cv::Mat all = ground.seen.empty() ? cv::Mat(grey.size(), CV_8UC1, cv::Scalar(255)) : ground.seen;
  const double picture_scale = ground.picture_gsd_m / ground.map_gsd_m,
               scale = side_px / kPlacePatch_px / picture_scale;
  const PatchCutter cutter(grey, all, scale);
  const int window_px =
      static_cast<int>(std::ceil(kPlacePatch_px * 1.5));  // holds the square under any turn, and shifts
  std::vector<Query> queries;
  for (int tries = 0; std::ssize(queries) < count && tries < 50 * count; ++tries) {
    const double half = side_px / 2 / picture_scale;
    const cv::Point2d at(random.uniform(half, grey.cols - half), random.uniform(half, grey.rows - half));
    const PlacePatch patch = cutter.cut({.centre = at,
                                         .turn_rad = random.uniform(-kPi, kPi),
                                         .pixels_per_px = scale,
                                         .shift_px = {},
                                         .side_px = window_px});
    // What a square camera sees.
    cv::Mat seen = cv::Mat::zeros(patch.mask.size(), CV_8UC1);
    const int first = (window_px - kPlacePatch_px) / 2;
    const cv::Rect square(first, first, kPlacePatch_px, kPlacePatch_px);
    patch.mask(square).copyTo(seen(square));
    if (cv::countNonZero(seen) < kLeastValid * kPlacePatch_px * kPlacePatch_px) continue;
    queries.push_back({{patch.grey, seen, 1, all_turns()}, at * picture_scale});
  }
  return queries;
}

std::vector<Query> recorded_queries(const Ground& ground, double side_px, Random random) {
  std::vector<Query> queries;
  const double gsd_m = side_px * ground.map_gsd_m / kPlacePatch_px;
  for (const RecordedFrame& frame : ground.frames) {
    const cv::Mat grey = read_image_file(frame.file, Colour::grey, 2);
    CameraModel camera = ground.camera.camera.scaled(0.5);
    camera.width = grey.cols, camera.height = grey.rows;
    const CameraPose pose{{0, 0}, frame.agl_m, {random.uniform(-kPi, kPi), 0, 0}};
    const auto box = footprint_of(camera, pose);
    if (!box) continue;
    const GroundGrid grid{box->west_m, box->north_m, gsd_m,
                          static_cast<int>(std::ceil((box->east_m - box->west_m) / gsd_m)),
                          static_cast<int>(std::ceil((box->north_m - box->south_m) / gsd_m))};
    const RectifiedFrame seen = rectify(reduce_frame(grey, camera, frame.agl_m, gsd_m), pose, grid);
    queries.push_back({{seen.image, seen.mask, 1, all_turns()},
                       {ground.map_image.cols / 2.0 + frame.truth.east_m / ground.map_gsd_m,
                        ground.map_image.rows / 2.0 - frame.truth.north_m / ground.map_gsd_m}});
  }
  return queries;
}

struct Found {
  std::size_t queries = 0, squares = 0;
  std::array<std::size_t, kAt.size()> hits{};
  double chance = 0;  // of the first, drawn blindly: sum over the queries
  double seconds = 0;
  void add(const Found& other) {
    queries += other.queries, squares += other.squares, chance += other.chance, seconds += other.seconds;
    for (std::size_t k = 0; k < kAt.size(); ++k) hits[k] += other.hits[k];
  }
};

Found ask(const PlaceGallery& gallery, const Squares& squares, const std::vector<Query>& queries) {
  Found found;
  found.squares = squares.patches.size();
  const auto inside = [&](std::size_t square, cv::Point2d place) {
    const cv::Point2d off = squares.middles[square] - place;
    return std::max(std::abs(off.x), std::abs(off.y)) <= squares.side_px / 2;
  };
  const auto began = std::chrono::steady_clock::now();
  for (const Query& query : queries) {
    ++found.queries;
    double right = 0;
    for (std::size_t i = 0; i < squares.middles.size(); ++i) right += inside(i, query.place) ? 1 : 0;
    found.chance += right / static_cast<double>(squares.middles.size());
    const auto ranked = gallery.rank(query.view, kAt.back());
    const auto hit = std::find_if(ranked.begin(), ranked.end(), [&](std::size_t i) { return inside(i, query.place); });
    for (std::size_t k = 0; k < kAt.size(); ++k) {
      if (hit != ranked.end() && hit - ranked.begin() < static_cast<std::ptrdiff_t>(kAt[k])) ++found.hits[k];
    }
  }
  found.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  return found;
}

void print(const std::string& set, std::string_view descriptor, const Found& found) {
  const auto of = [&](double part) {
    return 100 * part / static_cast<double>(std::max<std::size_t>(1, found.queries));
  };
  fmt::print("| {:<22} | {:<24} | {:5} | {:7} | {:5.1f} % | {:5.1f} % | {:5.1f} % | {:6.1f} % | {:4.0f} |\n", set,
             descriptor, found.queries, found.squares, of(static_cast<double>(found.hits[0])),
             of(static_cast<double>(found.hits[1])), of(static_cast<double>(found.hits[2])), of(found.chance),
             1000 * found.seconds / static_cast<double>(std::max<std::size_t>(1, found.queries)));
  std::fflush(stdout);
}

// Grounds whose figures are summed up in one row.
std::string set_of(const Ground& ground) { return ground.name.starts_with("pair") ? "gearth pairs" : ground.name; }

int run(const std::filesystem::path& data, int count, std::uint64_t seed) {
  if (data.empty()) {
    fmt::print("NOT RUN: the real sets are not here; set NADIR_DATA to the folder that holds them\n");
    return 0;
  }
  fmt::print(
      "| {:<22} | {:<24} | {:<5} | {:<7} | at 1    | at 5    | at 20   | chance   | ms   "
      "|\n|---|---|---|---|---|---|---|---|---|\n",
      "picture, map", "descriptor", "asked", "squares");
  const Random seeded(seed);
  std::map<std::string, std::map<std::string, Found>> pairs;  // by set and descriptor
  for (const Purpose purpose : {Purpose::train, Purpose::judge}) {
    const Grounds grounds(purpose, 0, first_world(purpose), data);
    for (const Ground& ground : grounds.real()) {
      const double side_px = side_of(ground);
      const Squares squares = squares_of(ground.map_image, side_px);
      if (squares.patches.size() < kAt.back()) continue;
      const std::vector<Query> queries = ground.frames.empty()
                                             ? drawn_queries(ground, side_px, count, seeded.fork(ground.name))
                                             : recorded_queries(ground, side_px, seeded.fork(ground.name));
      for (const auto& describer : describers()) {
        describer->train(squares.patches);
        const Found found = ask(PlaceGallery(*describer, squares.patches), squares, queries);
        const std::string set = set_of(ground);
        if (set == ground.name) {
          print(set, describer->name(), found);
        } else {
          pairs[set][std::string(describer->name())].add(found);
        }
      }
    }
  }
  for (const auto& [set, by_descriptor] : pairs) {
    for (const auto& [descriptor, found] : by_descriptor) print(set, descriptor, found);
  }
  return 0;
}

}  // namespace
}  // namespace nadir::bench

int main(int argc, char** argv) {
  CLI::App app("Recall of place retrieval over real imagery of two dates, headings unknown");
  std::string data = nadir::bench::data_folder().string();
  int count = 60;
  std::uint64_t seed = 1'000'001;
  app.add_option("--data", data, "folder of the real sets; default: $NADIR_DATA, else ../shared/data");
  app.add_option("--queries", count, "pictures of each pair of dates (60); of recorded flights, all frames");
  app.add_option("--seed", seed, "of the places and headings");
  CLI11_PARSE(app, argc, argv);
  return nadir::bench::run(data, count, seed);
}
