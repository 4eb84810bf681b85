// Where the CPU time of a replayed frame goes. Each stage is run on its own over the frames of a flight, with its own
// clock: the CPU time of the whole process, so that threads of libraries count. The attempt's stages start from the
// true position, with the window and the headings and heights that a flight between two anchors has.
//
//   stages PACKAGE ROOT.json AT FRAMES TELEMETRY CAMERA TRUTH
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <opencv2/core.hpp>
#include <string>

#include "base/platform.hpp"
#include "circumstances.hpp"
#include "cpu_time.hpp"
#include "estimation/localizer.hpp"
#include "estimation/visual_odometry.hpp"
#include "imagery/map_window.hpp"
#include "package/open_package.hpp"
#include "replay/flight_folder.hpp"
#include "replay/flight_request.hpp"
#include "replay/score.hpp"
#include "vision/camera_frame.hpp"
#include "vision/map_matcher.hpp"
#include "vision/matching_plan.hpp"
#include "vision/oriented_channels.hpp"
#include "vision/patch_matching.hpp"

namespace nadir {
namespace {

using bench::cpu_ms;

constexpr double kHeadingRange_rad = 0.12, kScaleRange = 0.06, kRadius_m = 60;

class Stages {
 public:
  auto run(const std::string& name, auto&& work) {
    const double before = cpu_ms();
    auto result = work();
    times_[name].push_back(cpu_ms() - before);
    return result;
  }
  void print(const std::string& name, double whole_ms = 0) const {
    const auto times = times_.find(name);
    if (times == times_.end()) return;
    const Spread s = spread_of(times->second);
    fmt::print("{:<44} {:>8.1f} {:>8.1f} {:>8.1f} {:>8.1f}", name, s.mean, s.p50, s.p95, s.largest);
    fmt::print("{}\n", whole_ms > 0 ? fmt::format(" {:>6.0f} %", 100 * s.mean / whole_ms) : "");
  }
  double mean_of(const std::string& name) { return spread_of(times_[name]).mean; }

 private:
  std::map<std::string, std::vector<double>> times_;
};

// The stages of one attempt, from where the camera really was.
void attempt(Stages& stages, const cv::Mat& grey, const CameraModel& camera, MapMatcher& matcher,
             MapWindowReader& reader, const LocalFrame& frame, const CameraPose& pose) {
  AnchorPrior prior;
  prior.search = {pose, kRadius_m, kHeadingRange_rad, kScaleRange};
  const AnchorMatch match = stages.run("one attempt", [&] { return matcher.match(grey, prior); });
  if (match.fine_gsd_m <= 0 || match.search.places.empty()) return;
  const auto plan = matching_plan(camera, reader.zooms(), frame, prior.search);
  const auto read = [&] {
    return reader.read(frame, searched_ground(camera, prior, *plan), match.fine_gsd_m, Colour::grey);
  };
  read();  // the tiles are decoded then, as they are for all but the first attempt
  const MapWindow map = stages.run("map window", read);
  SearchOptions options = plan->options;
  stages.run("search", [&] { return search_window(grey, camera, map, prior.search, options); });
  options.candidates = 0;
  stages.run("sweep", [&] { return search_window(grey, camera, map, prior.search, options); });

  const CameraPose& found = match.search.places.front().pose;
  const auto box = footprint_of(camera, found);
  if (!box) return;
  GroundGrid grid{map.west_m, map.north_m, map.gsd_m, 0, 0};
  const int left = static_cast<int>((box->west_m - map.west_m) / map.gsd_m);
  const int top = static_cast<int>((map.north_m - box->north_m) / map.gsd_m);
  grid.west_m += left * map.gsd_m;
  grid.north_m -= top * map.gsd_m;
  grid.columns = static_cast<int>((box->east_m - box->west_m) / map.gsd_m) + 1;
  grid.rows = static_cast<int>((box->north_m - box->south_m) / map.gsd_m) + 1;
  const ReducedFrame reduced = stages.run("reduce", [&] { return reduce_frame(grey, camera, found.agl_m, map.gsd_m); });
  const RectifiedFrame rectified = stages.run("rectify, fine, once", [&] { return rectify(reduced, found, grid); });
  stages.run("channels, fine, once",
             [&] { return oriented_channels(rectified.image, rectified.mask, ChannelSet::six_orientations); });
  stages.run("patches, last round", [&] {
    return match_patches(rectified, reduced.camera, found, map, {48, 12, 8, 6, 0.2, {}});
  });
}

void follow(Stages& stages, OdometryFrontEnd& odometry, const cv::Mat& grey, const CameraModel& camera,
            const CameraPose& pose) {
  OdometryFrame seen;
  seen.grey = grey;
  seen.camera = camera;
  seen.attitude = pose.attitude;
  seen.agl_m = pose.agl_m;
  stages.run("odometry", [&] { return odometry.track(seen); });
}

}  // namespace

int run(const std::vector<std::string>& arguments) {
  const Flight flight = read_flight({arguments[3], arguments[4], arguments[5]});
  const Truth truth = read_truth(arguments[6], flight.frames);
  NoProgress progress;
  const Opening opening =
      open_flight_map({arguments[0], arguments[1], std::nullopt}, parse_utc(arguments[2]).value(), progress);
  if (!opening.package) return std::fputs("stages: the package is rejected\n", stderr), 1;
  const TileSource& tiles = opening.package->imagery();
  const LocalFrame frame = mission_frame(opening.package->mission());
  LocalizerConfig config;
  const int shrink = decode_reduction(flight.camera.camera.width, flight.camera.camera.height);
  CameraFile camera = flight.camera;
  camera.camera = camera.camera.scaled(1.0 / shrink);
  Localizer localizer(camera, frame, &tiles, truth.front(), config);
  const auto odometry = make_feature_odometry();
  const FlatGround ground;
  const auto matcher = make_channel_matcher({camera.camera, tiles, frame, ground});
  MapWindowReader reader(tiles, kCachedMapTiles);
  Stages stages;
  int anchored = 0;
  for (std::size_t i = 0; i < flight.frames.size(); ++i) {
    const Telemetry& telemetry = flight.frames[i];
    cv::Mat picture;
    const FrameReport report = stages.run("whole frame", [&] {
      picture = stages.run("decode", [&] { return read_grey_image(flight.frames_folder / telemetry.frame, shrink); });
      return localizer.process(picture, telemetry);
    });
    if (report.anchor.verdict == AnchorVerdict::accepted) ++anchored;
    if (picture.empty() || !truth[i]) continue;
    const PlanePoint at = frame.plane_from_lonlat(*truth[i]);
    const CameraPose pose{
        at,
        telemetry.agl_m.value_or(120),
        {telemetry.heading_rad.value_or(0), telemetry.pitch_rad.value_or(0), telemetry.roll_rad.value_or(0)}};
    follow(stages, *odometry, picture, camera.camera, pose);
    attempt(stages, picture, camera.camera, *matcher, reader, frame, pose);
  }
  fmt::print("{} frames of {} x {}, {} anchors, decoded at 1/{}; CPU ms\n", flight.frames.size(),
             flight.camera.camera.width, flight.camera.camera.height, anchored, shrink);
  fmt::print("{:<44} {:>8} {:>8} {:>8} {:>8}\n", "", "mean", "p50", "p95", "largest");
  for (const char* name : {"whole frame", "decode", "odometry"}) stages.print(name, stages.mean_of("whole frame"));
  const double attempt_ms = stages.mean_of("one attempt");
  for (const char* name : {"one attempt", "map window", "search", "sweep", "reduce", "rectify, fine, once",
                           "channels, fine, once", "patches, last round"}) {
    stages.print(name, attempt_ms);
  }
  fmt::print("{}\n\n", circumstances());
  return 0;
}

}  // namespace nadir

int main(int argc, char** argv) {
  nadir::keep_freed_memory();  // as nadird does
  if (argc != 8) return std::fputs("usage: stages PACKAGE ROOT.json AT FRAMES TELEMETRY CAMERA TRUTH\n", stderr), 2;
  try {
    return nadir::run({argv + 1, argv + argc});
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "stages: %s\n", error.what()), 2;
  }
}
