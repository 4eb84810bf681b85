#include "replay/replay_flight.hpp"

#include <chrono>

#include "estimation/localizer.hpp"
#include "replay/pictures.hpp"
#include "replay/score.hpp"
#include "vision/flight_picture.hpp"

namespace nadir {
namespace {

constexpr std::size_t kPicturedFrames = 12;

std::optional<double> error_of(const Estimate& estimate, const std::optional<LonLat>& truth, const LocalFrame& frame) {
  return errors_m({estimate}, {truth}, frame).front();
}

}  // namespace

ReplayedFlight replay_flight(const Flight& flight, const ReplaySetup& setup, const Truth& truth, EstimatesCsv& csv,
                             Progress& progress) {
  LocalizerConfig config;
  if (setup.map_sigma_m) config.map_sigma_m = *setup.map_sigma_m;
  config.surface = setup.surface;
  config.area = setup.area;
  config.places = setup.places;
  config.odometry = setup.odometry;
  config.matcher = setup.matcher;
  const int shrink = harmless_shrink(flight.camera.camera.width, flight.camera.camera.height);
  CameraFile camera = flight.camera;
  camera.camera = camera.camera.scaled(1.0 / shrink);
  Localizer localizer(camera, setup.frame, setup.tiles, setup.start, config);
  ReplayedFlight result;
  WorstFrames worst(kPicturedFrames);
  progress.begin("replay", flight.frames.size(), "frames");
  for (std::size_t i = 0; i < flight.frames.size(); ++i) {
    const auto before = std::chrono::steady_clock::now();
    const cv::Mat picture = read_picture(flight.frames_folder / flight.frames[i].frame, shrink);
    FrameReport report = localizer.process(picture, flight.frames[i]);
    const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - before;
    report.estimate.latency_ms = spent.count();  // decoding included: that is what a frame costs
    csv.write(report.estimate);

    worst.offer(i, badness_of(report, error_of(report.estimate, truth[i], setup.frame)), report.anchor);
    report.anchor.rectified.release();
    report.anchor.matched_map.release();
    result.frames.push_back(std::move(report));
    progress.advance(1);
  }
  progress.end();
  result.refined = localizer.refined();
  result.worst = worst.worst_first();
  return result;
}

}  // namespace nadir
