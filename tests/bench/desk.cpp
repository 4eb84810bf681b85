// Stored flights: how long it takes to create one, to store a batch of full-HD pictures, to process a frame, to restore
// the frames that were processed, and to place an object that frames show. The bars are those of an analyst's desk on
// two cores.
//
// Usage: bench_desk FOLDER (to be created; removed at the end)
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <vector>

#include "adjustment/object_place.hpp"
#include "base/random.hpp"
#include "estimation/localizer_fixture.hpp"
#include "flights/flight_engine.hpp"
#include "flights/flight_store.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"

using namespace nadir;
using namespace nadir::test;

namespace {

constexpr int kBatches = 12, kBatchPictures = 50, kFrames = 200;

double elapsed_s(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

FlightDescription description(const CameraFile& camera) {
  FlightDescription flight;
  flight.name = "bench";
  flight.session.camera = camera;
  flight.session.origin = kOrigin;
  return flight;
}

void print(const char* what, double value, const char* unit, const char* bar) {
  fmt::print("| {:<46} | {:>9.3f} {:<2} | {:<10} |\n", what, value, unit, bar);
}

// Structure like that of a landscape, so that the files have the size of real ones.
Bytes full_hd_picture(int number) {
  Random random(static_cast<std::uint64_t>(number));
  cv::Mat coarse(135, 240, CV_8UC3), image;
  for (std::size_t i = 0; i < coarse.total() * 3; ++i)
    coarse.data[i] = static_cast<std::uint8_t>(random.integer(0, 255));
  cv::Mat whole(1080, 1920, CV_8UC3);
  for (int row = 0; row < whole.rows; ++row) {
    for (int column = 0; column < whole.cols; ++column) {
      whole.at<cv::Vec3b>(row, column) = coarse.at<cv::Vec3b>(row / 8, column / 8);
    }
  }
  return encode_image(whole, ImageFormat::jpeg, 90);
}

void intake(const std::filesystem::path& folder) {
  CameraFile camera = flight_camera();
  camera.camera.width = 1920;
  camera.camera.height = 1080;
  const auto before = std::chrono::steady_clock::now();
  const auto store = FlightStore::create(folder, description(camera), system_clock_millis());
  print("create a flight (without verifying a package)", 1000 * elapsed_s(before), "ms", "< 500 ms");
  std::vector<double> seconds;
  std::uint64_t bytes = 0;
  int number = 0;
  for (int batch = 0; batch < kBatches; ++batch) {
    std::vector<Bytes> pictures;
    std::vector<PictureOffer> offers;
    for (int i = 0; i < kBatchPictures; ++i) pictures.push_back(full_hd_picture(number + i));
    for (const Bytes& picture : pictures) {
      PictureOffer& offer = offers.emplace_back();
      offer.name = fmt::format("{:06}.jpg", number);
      offer.telemetry.time_s = number++;
      offer.bytes = picture;
      bytes += picture.size();
    }
    const auto started = std::chrono::steady_clock::now();
    store->accept(offers, system_clock_millis());
    seconds.push_back(elapsed_s(started));
  }
  fmt::print("{} pictures of 1920×1080, {:.2f} MB each\n", store->accepted(),
             static_cast<double>(bytes) / 1e6 / static_cast<double>(store->accepted()));
  print("batch of 50, median", median(seconds), "s", "< 2 s");
  print("batch of 50, longest", *std::max_element(seconds.begin(), seconds.end()), "s", "< 2 s");
}

// Circles over the synthetic landscape.
void processing(const std::filesystem::path& folder) {
  const CameraFile camera = flight_camera();
  FlightEngineSetup setup{.camera = camera,
                          .shrink = 1,
                          .frame = LocalFrame(kOrigin),
                          .tiles = &landscape_tiles(),
                          .start = place_of({0, -95}),
                          .localizer = config()};
  FlightDescription flight = description(camera);
  flight.session.start = setup.start;
  const auto store = FlightStore::create(folder, flight, system_clock_millis());
  for (int i = 0; i < kFrames; ++i) {
    const double angle = radians(15.0 * i);
    const CameraPose pose{{95 * std::sin(angle), -95 * std::cos(angle)}, 100, {radians(90) - angle, 0, 0}};
    const Bytes picture =
        encode_image(photograph(landscape_ground(), camera.camera, pose), ImageFormat::jpeg, 90 + i * 10 / kFrames);
    PictureOffer offer;
    offer.name = fmt::format("{:06}.jpg", i);
    offer.telemetry.time_s = 1.5 * i;
    offer.telemetry.agl_m = 100;
    offer.telemetry.heading_rad = wrap_pi(pose.attitude.heading_rad);
    offer.telemetry.pitch_rad = offer.telemetry.roll_rad = 0;
    offer.bytes = picture;
    store->accept({&offer, 1}, system_clock_millis());
  }
  auto started = std::chrono::steady_clock::now();
  {
    FlightEngine engine(*store, setup);
    engine.process();
  }
  const auto frames = static_cast<double>(store->processed());
  const double processed_s = elapsed_s(started);
  std::vector<double> latency_ms;
  std::size_t anchored = 0;
  for (const Estimate& estimate : store->estimates(EstimateKind::online)) {
    latency_ms.push_back(estimate.latency_ms);
    anchored += estimate.source == SourceLabel::satellite_anchored ? 1U : 0U;
  }
  fmt::print("{} frames of 320×240, {} anchored\n", store->processed(), anchored);
  print("frame, median", median(latency_ms), "ms", "≤ 300 ms");
  print("storing a frame and its events, mean",
        (1000 * processed_s -
         [&] {
           double sum = 0;
           for (const double one : latency_ms) sum += one;
           return sum;
         }()) /
            frames,
        "ms", "");
  FlightEngine again(*store, setup);
  started = std::chrono::steady_clock::now();
  again.process();
  print("restoring a frame when the flight is resumed", 1000 * elapsed_s(started) / frames, "ms", "");
  started = std::chrono::steady_clock::now();
  again.complete();
  print("completing the flight", elapsed_s(started), "s", "");
  const auto database = static_cast<double>(std::filesystem::file_size(folder / kFlightFile));
  print("database, of each frame", database / 1000 / frames, "kB", "");
}

// The same point of the ground, clicked in one frame and in three. Place and error ellipse.
void objects() {
  constexpr int kRepeats = 200;
  const CameraModel camera = flight_camera().camera;
  const FlatGround ground;
  PoseCovariance covariance = PoseCovariance::Identity() * 1e-4;
  covariance.topLeftCorner<3, 3>() = 4 * Eigen::Matrix3d::Identity();
  std::vector<SightedFrame> frames;
  std::vector<ObjectSighting> clicks;
  for (std::size_t i = 0; i < 3; ++i) {
    frames.push_back({{{-20 + 20.0 * static_cast<double>(i), 0}, 100, {radians(90), 0, 0}}, covariance});
    const Eigen::Vector3d point = camera_from_ground(frames.back().pose, {10, 15});
    clicks.push_back({i, camera.pixel_from_point(point)});
  }
  for (const std::size_t count : {std::size_t{1}, clicks.size()}) {
    const auto started = std::chrono::steady_clock::now();
    std::size_t placed = 0;
    for (int i = 0; i < kRepeats; ++i) {
      const auto found = place_object(camera, ground, frames, {clicks.data(), count}, 1);
      placed += std::holds_alternative<LocatedObject>(found) ? 1U : 0U;
    }
    if (placed != kRepeats) throw std::runtime_error("an object has no place");
    const std::string what =
        fmt::format("place of an object, clicked in {}", count == 1 ? "one frame" : "three frames");
    print(what.c_str(), 1000 * elapsed_s(started) / kRepeats, "ms", "≤ 50 ms");
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2 || std::filesystem::exists(argv[1])) {
    fmt::print(stderr, "usage: bench_desk FOLDER (to be created)\n");
    return 2;
  }
  const std::filesystem::path folder = argv[1];
  std::filesystem::create_directory(folder);
  intake(folder / "intake");
  processing(folder / "processing");
  objects();
  std::filesystem::remove_all(folder);
  return 0;
}
