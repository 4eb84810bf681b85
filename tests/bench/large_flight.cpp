// A long flight of large pictures through a stored flight: 3000 pictures of 26 megapixels, from intake to the refined
// track. How much memory, how long a frame, how far the track drifts over its length?
//
// A child process paints the ground beneath a straight flight and writes the pictures of a batch; this process takes
// them in, processes them, and completes the flight. Without a map: all memory is that of the flight itself.
//
// Usage: bench_large_flight FOLDER [FRAMES]   (FOLDER is created, holds 4 MB a frame, and is removed at the end)
#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/files.hpp"
#include "base/input_file.hpp"
#include "base/quantile.hpp"
#include "base/random.hpp"
#include "flights/flight_engine.hpp"
#include "flights/flight_store.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "vision/camera_frame.hpp"

using namespace nadir;

namespace {

namespace fs = std::filesystem;

const cv::Size kPicture(6252, 4168);
constexpr double kFocal_px = 5000, kAgl_m = 250, kGsd_m = kAgl_m / kFocal_px;
constexpr int kStep_px = 1250, kGround_px = 19 * kStep_px;  // the painted ground repeats; the flight does not
constexpr double kInterval_s = 3;
constexpr int kBatch = 25, kQuality = 70;
const LonLat kOrigin{23.71, 61.49};

// Spots of all sizes, periodic from west to east.
cv::Mat painted_ground() {
  Random random(1);
  cv::Mat ground(kPicture.height, kGround_px, CV_8UC3, cv::Scalar::all(90));
  for (int spot_px = 512; spot_px >= 8; spot_px /= 2) {
    cv::Mat coarse((kPicture.height + spot_px - 1) / spot_px, kGround_px / spot_px, CV_8UC3), fine, sum;
    for (std::size_t i = 0; i < coarse.total() * 3; ++i) {
      coarse.data[i] = static_cast<std::uint8_t>(random.integer(0, 70));
    }
    cv::copyMakeBorder(coarse, coarse, 0, 0, 1, 1, cv::BORDER_WRAP);
    cv::resize(coarse, fine, {coarse.cols * kGround_px / (coarse.cols - 2), kPicture.height}, 0, 0, cv::INTER_CUBIC);
    const int border_px = (fine.cols - kGround_px) / 2;
    cv::addWeighted(ground, 1, fine.colRange(border_px, border_px + kGround_px), 1, -35, sum);
    ground = sum;
  }
  return ground;
}

// With some cars on it, which make every picture another one.
cv::Mat picture_of(const cv::Mat& ground, int frame) {
  const int left = static_cast<int>((static_cast<std::int64_t>(frame) * kStep_px) % kGround_px);
  cv::Mat picture(kPicture, CV_8UC3);
  const int first = std::min(kPicture.width, kGround_px - left);
  ground.colRange(left, left + first).copyTo(picture.colRange(0, first));
  if (first < kPicture.width)
    ground.colRange(0, kPicture.width - first).copyTo(picture.colRange(first, kPicture.width));
  Random random = Random(2).fork("cars", static_cast<std::uint64_t>(frame));
  for (int car = 0; car < 12; ++car) {
    const cv::Point at(random.integer(100, kPicture.width - 200), random.integer(100, kPicture.height - 200));
    cv::rectangle(picture, {at, cv::Size(90, 40)}, cv::Scalar::all(random.integer(0, 255)), cv::FILLED);
  }
  return picture;
}

std::string name_of_frame(int frame) { return fmt::format("{:06}.jpg", frame); }

// Writes pictures until the parent is too far behind; a picture has its name when it is complete.
[[noreturn]] void paint(const fs::path& folder, int frames) {
  const cv::Mat ground = painted_ground();
  for (int frame = 0; frame < frames; ++frame) {
    while (frame >= 2 * kBatch && fs::exists(folder / name_of_frame(frame - 2 * kBatch))) ::usleep(20'000);
    const Bytes bytes = encode_image(picture_of(ground, frame), ImageFormat::jpeg, kQuality);
    PendingFile(folder / name_of_frame(frame), bytes).replace();
  }
  std::_Exit(0);
}

double elapsed_s(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}

double peak_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024;
}

// With what is not yet moved from its log.
std::uintmax_t database_bytes(const fs::path& flight) {
  std::uintmax_t bytes = 0;
  for (const auto& file : fs::directory_iterator(flight)) {
    if (file.path().filename().string().starts_with(kFlightFile)) bytes += file.file_size();
  }
  return bytes;
}

CameraFile camera_file() {
  CameraFile file;
  file.camera = {
      kPicture.width, kPicture.height, kFocal_px, kFocal_px, kPicture.width / 2.0 - 0.5, kPicture.height / 2.0 - 0.5};
  file.uncertainty = {radians(1), 0.015, radians(1)};
  return file;
}

void take_in(FlightStore& store, const fs::path& pictures, int first, int frames) {
  Random random = Random(3).fork("telemetry", static_cast<std::uint64_t>(first));
  std::vector<PictureOffer> batch;
  const Directory folder(pictures);
  for (int frame = first; frame < std::min(frames, first + kBatch); ++frame) {
    while (!fs::exists(pictures / name_of_frame(frame))) ::usleep(20'000);
    PictureOffer& offer = batch.emplace_back();
    offer.name = name_of_frame(frame);
    offer.folder = &folder;
    offer.telemetry.time_s = kInterval_s * frame;
    offer.telemetry.agl_m = kAgl_m * (1 + random.normal(0, 0.01));
    offer.telemetry.heading_rad = random.normal(0, radians(0.7));
    offer.telemetry.pitch_rad = random.normal(0, radians(0.3));
    offer.telemetry.roll_rad = random.normal(0, radians(0.3));
  }
  for (const PictureAnswer& answer : store.accept(batch, system_clock_millis())) {
    if (answer.refusal) throw std::runtime_error(answer.name + ": " + answer.refusal->reason);
  }
  for (const PictureOffer& offer : batch) fs::remove(pictures / offer.name);
}

void fly(const fs::path& folder, int frames) {
  const CameraFile camera = camera_file();
  const int shrink = decode_reduction(kPicture.width, kPicture.height);
  FlightDescription description;
  description.name = "large pictures";
  description.session.camera = camera;
  description.session.origin = kOrigin;
  description.session.start = kOrigin;
  description.session.picture_shrink = shrink;
  const auto store = FlightStore::create(folder / "flight", description, system_clock_millis());
  LocalizerConfig config;
  config.no_fix_sigma_m = 1e9;  // nothing anchors it
  FlightEngine engine(
      *store,
      {.camera = camera, .shrink = shrink, .frame = LocalFrame(kOrigin), .start = kOrigin, .localizer = config});
  const auto started = std::chrono::steady_clock::now();
  double intake_s = 0;
  for (int first = 0; first < frames; first += kBatch) {
    const auto before = std::chrono::steady_clock::now();
    take_in(*store, folder / "pictures", first, frames);
    intake_s += elapsed_s(before);
    engine.process();
    if ((first / kBatch) % 8 == 0) {
      fmt::print(stderr, "{} of {} frames, {:.0f} s, peak {:.0f} MB\n", store->processed(), frames, elapsed_s(started),
                 peak_mb());
    }
  }
  const double processed_mb = peak_mb(), processed_s = elapsed_s(started);
  const auto completing = std::chrono::steady_clock::now();
  engine.complete();

  std::vector<double> latency_ms;
  std::size_t tracked = 0;
  const auto online = store->estimates(EstimateKind::online);
  for (const Estimate& estimate : online) {
    latency_ms.push_back(estimate.latency_ms);
    tracked += estimate.segment == online.front().segment ? 1U : 0U;
  }
  const LocalFrame plane(kOrigin);
  const PlanePoint end = plane.plane_from_lonlat(online.back().position.value());
  const double way_m = (frames - 1) * kStep_px * kGsd_m;
  fmt::print("{} pictures of {} x {}, decoded at 1/{}\n", online.size(), kPicture.width, kPicture.height, shrink);
  fmt::print("| | |\n|---|---|\n");
  fmt::print("| frame, median and 99 % | {:.0f} and {:.0f} ms |\n", quantile(latency_ms, 0.5),
             quantile(latency_ms, 0.99));
  fmt::print("| intake of a batch of {}, painting included | {:.1f} s |\n", kBatch, intake_s * kBatch / frames);
  fmt::print("| all frames, painting included | {:.0f} s |\n", processed_s);
  fmt::print("| completing | {:.1f} s |\n", elapsed_s(completing));
  fmt::print("| peak memory until then, at the end (bar: 2048 MB) | {:.0f}, {:.0f} MB |\n", processed_mb, peak_mb());
  fmt::print("| database, of each frame | {:.1f} kB |\n",
             static_cast<double>(database_bytes(folder / "flight")) / 1000 / frames);
  fmt::print("| frames in one segment | {} of {} |\n", tracked, frames);
  fmt::print("| end of the track after {:.1f} km | {:.2f} % off |\n", way_m / 1000,
             100 * std::hypot(end.east_m - way_m, end.north_m) / way_m);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3 || fs::exists(argv[1])) {
    fmt::print(stderr, "usage: bench_large_flight FOLDER [FRAMES] (the folder is created)\n");
    return 2;
  }
  const fs::path folder = argv[1];
  const int frames = argc > 2 ? std::atoi(argv[2]) : 3000;
  fs::create_directories(folder / "pictures");
  const pid_t painter = ::fork();
  if (painter == 0) paint(folder / "pictures", frames);
  int code = 0;
  try {
    fly(folder, frames);
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
    ::kill(painter, SIGKILL);
    code = 1;
  }
  ::waitpid(painter, nullptr, 0);
  fs::remove_all(folder);
  return code;
}
