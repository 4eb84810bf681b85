#include "replay/replay_flight.hpp"

#include <chrono>

#include "estimation/localizer.hpp"
#include "replay/pictures.hpp"
#include "replay/recorded_walk.hpp"
#include "replay/score.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {
namespace {

constexpr std::size_t kPicturedFrames = 12;

std::optional<double> error_of(const Estimate& estimate, const std::optional<LonLat>& truth, const LocalFrame& frame) {
  return errors_m({estimate}, {truth}, frame).front();
}

}  // namespace

LocalizerConfig localizer_config(const ReplaySetup& setup) {
  LocalizerConfig config;
  if (setup.map_sigma_m) config.map_sigma_m = *setup.map_sigma_m;
  config.area = setup.area;
  if (setup.recorded != nullptr) config = setup.recorded->session.localizer;
  config.surface = setup.surface;
  const bool asked = setup.recorded == nullptr || setup.recorded->session.places;
  config.places = asked ? setup.places : nullptr;
  config.odometry = setup.odometry;
  config.matcher = setup.matcher;
  return config;
}

int picture_shrink(const Flight& flight, const ReplaySetup& setup) {
  if (setup.recorded != nullptr) return setup.recorded->session.picture_shrink;
  return decode_reduction(flight.camera.camera.width, flight.camera.camera.height);
}

ReplayedFlight replay_flight(const Flight& flight, const ReplaySetup& setup, const Truth& truth, EstimatesCsv* csv,
                             Progress& progress) {
  const int shrink = picture_shrink(flight, setup);
  CameraFile camera = flight.camera;
  camera.camera = camera.camera.scaled(1.0 / shrink);
  Localizer localizer(camera, setup.frame, setup.tiles, setup.start, localizer_config(setup));
  RecordedWalk walk(localizer, setup.recorded);
  ReplayedFlight result;
  WorstFrames worst(kPicturedFrames);
  progress.begin("replay", flight.frames.size(), "frames");
  for (std::size_t i = 0; i < flight.frames.size(); ++i) {
    if (setup.recording != nullptr) setup.recording->before(i, flight.frames[i], flight.picture(i));
    const auto before = std::chrono::steady_clock::now();
    const cv::Mat picture = read_flight_picture(flight.picture(i), camera.camera, shrink);
    FrameReport report = walk.frame(picture, flight.frames[i], result.told);
    const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - before;
    report.estimate.latency_ms = spent.count();  // decoding included: that is what a frame costs
    if (csv != nullptr) csv->write(report.estimate);
    if (setup.recording != nullptr) setup.recording->after(i, report);

    worst.offer(i, badness_of(report, error_of(report.estimate, truth[i], setup.frame)), report.anchor);
    report.anchor.rectified.release();
    report.anchor.matched_map.release();
    result.frames.push_back(std::move(report));
    progress.advance(1);
  }
  progress.end();
  result.refined = localizer.refined();
  result.poses = localizer.refined_poses();
  result.worst = worst.worst_first();
  return result;
}

}  // namespace nadir
