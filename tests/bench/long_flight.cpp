#include "long_flight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <vector>

#include "base/error.hpp"
#include "cpu_time.hpp"
#include "estimation/localizer.hpp"
#include "geodesy/angles.hpp"
#include "safety_judge.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/noise.hpp"
#include "simulation/telemetry_noise.hpp"

namespace nadir::bench {
namespace {

constexpr double kLeg_m = 900, kRow_m = 150;  // so that a banked frame still sees the world
constexpr double kStartSigma_m = 30;
constexpr int kOutlierEvery = 50;

constexpr std::array kConditions = {
    LongCondition{"nominal"},
    LongCondition{.name = "outliers 350 m off", .outliers = true},
    LongCondition{.name = "20 % blackout", .blackout = true},
    LongCondition{.name = "20 % blackout, IMU", .blackout = true, .imu = true},
    LongCondition{.name = "height 15 % off", .height_factor = 1.15},
    LongCondition{.name = "heading 8 deg off", .heading_off_deg = 8},
    LongCondition{.name = "compass deviates 9 deg", .deviation_deg = 9},
    LongCondition{
        .name = "all of these", .outliers = true, .blackout = true, .height_factor = 1.15, .heading_off_deg = 8},
    LongCondition{.name = "night", .night = true},
    LongCondition{.name = "old map", .old_map = true},
};

// Parallel rows over the middle of the world, in a direction drawn from the seed, with two 90 degree turns per row.
std::vector<FlightPose> path_of(Random random, std::uint64_t seed, int frames) {
  FlightPathOptions options;
  options.agl_m = random.uniform(160, 240);
  options.speed_mps = 20;
  options.max_frames = frames;
  options.interval_s = 1.2;
  const double along = random.uniform(-kPi, kPi);
  constexpr int kRows = 7;
  PlanePath route;
  for (int row = 0; row < kRows; ++row) {
    for (const double end : {row % 2 == 0 ? -0.5 : 0.5, row % 2 == 0 ? 0.5 : -0.5}) {
      const double x = end * kLeg_m, y = (row - (kRows - 1) / 2.0) * kRow_m;
      route.push_back({x * std::sin(along) + y * std::cos(along), x * std::cos(along) - y * std::sin(along)});
    }
  }
  return simulate_flight_path(route, GroundShape(), options, seed);
}

// Which frames cannot be decoded.
std::vector<bool> black_frames(Random random, std::size_t frames) {
  std::vector<bool> black(frames, false);
  std::size_t left = frames / 5;
  while (left > 0) {
    const auto from = static_cast<std::size_t>(random.integer(5, static_cast<int>(frames) - 25));
    const auto to = from + static_cast<std::size_t>(random.integer(4, 20));
    for (std::size_t i = from; i < to && left > 0; ++i) {
      if (black[i]) continue;
      black[i] = true;
      --left;
    }
  }
  return black;
}

// Counts a loss when the track breaks, and whether and when an anchor recovers it.
class Losses {
 public:
  void see(const FrameReport& report, bool first, LongRecord& record) {
    const bool anchored = report.anchor.verdict == AnchorVerdict::accepted;
    if (!first && !report.odometry.tracked && !lost_) {
      ++record.losses;
      lost_ = true;
      usable_frames_ = 0;
    }
    if (!lost_) return;
    if (report.anchor.verdict != AnchorVerdict::frame_unfit) ++usable_frames_;
    if (!anchored) return;
    ++record.recovered;
    record.longest_recovery = std::max(record.longest_recovery, usable_frames_);
    lost_ = false;
  }

 private:
  bool lost_ = false;
  int usable_frames_ = 0;
};

}  // namespace

std::span<const LongCondition> long_conditions() { return kConditions; }

LongFlights::LongFlights(int worlds, int frames, std::uint64_t base_seed, MapMatcherFactory matcher)
    : frames_(frames),
      photographer_(camera_file().camera),
      worlds_(worlds, first_world_of(base_seed)),
      matcher_(std::move(matcher)) {}

LongRecord LongFlights::run(std::uint64_t base_seed, std::uint64_t index,
                            const std::function<void(const std::string&)>& talk) const {
  const LongCondition& condition = kConditions[index % kConditions.size()];
  // Flights of one round differ only in their condition.
  const std::uint64_t round = index / kConditions.size(), seed = hash_of(base_seed, static_cast<std::int64_t>(round));
  const std::size_t number = round % worlds_.all.size();
  const World& world = *worlds_.all[number];
  const Random base(seed);
  Random light = base.fork("light"), faults = base.fork("faults"), start = base.fork("start"),
         night = base.fork("night");
  const double abeam = base.fork("compass").uniform(-kPi, kPi);  // the course on which the compass does not deviate
  const CameraFile file = camera_file();
  const CameraSensor sensor({file.camera.width, file.camera.height}, file.camera.fx, seed);
  TelemetryNoise noise(file.uncertainty, seed);
  const std::vector<FlightPose> path = path_of(base.fork("path"), seed, frames_);
  const std::vector<bool> black = black_frames(base.fork("black"), path.size());

  LocalizerConfig config;
  config.start_sigma_m = kStartSigma_m;
  config.map_sigma_m = world.map_sigma_m;
  config.surface = &world.terrain;
  config.matcher = matcher_;
  const double north_m = start.normal(0, kStartSigma_m), east_m = start.normal(0, kStartSigma_m);
  const LonLat measured_start =
      frame().lonlat_from_plane({path.front().position.x() + east_m, path.front().position.y() + north_m});
  const TileSource& map = condition.old_map ? *worlds_.old_maps[number] : world.map;
  Localizer localizer(file, frame(), &map, measured_start, config);

  LongRecord record;
  record.index = index;
  record.condition = condition.name;
  Losses losses;
  std::vector<CameraPose> truths;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const CameraPose truth{{path[i].position.x(), path[i].position.y()}, path[i].agl_m, path[i].attitude};
    truths.push_back(truth);
    CameraPose seen = truth;
    const double direction = faults.uniform(-kPi, kPi);
    if (condition.outliers && i % kOutlierEvery == kOutlierEvery / 2) {
      seen.position = {seen.position.east_m + 350 * std::sin(direction),
                       seen.position.north_m + 350 * std::cos(direction)};
    }
    Exposure exposure;
    exposure.gain = light.uniform(0.85, 1.25);
    exposure.warmth = light.uniform(-1, 1);
    exposure.motion_px = {light.normal(0, 0.3), light.normal(0, 0.5)};
    cv::Mat picture;
    if (!condition.blackout || !black[i]) {
      picture = photographer_.photograph(world, seen);
      sensor.expose(picture, exposure, i);
      if (condition.night) make_night(picture, night);
    }
    const MeasuredPose measured = noise.measure(path[i]);
    Telemetry telemetry;
    telemetry.time_s = 100 + measured.time_s;
    telemetry.agl_m = measured.agl_m * condition.height_factor;
    telemetry.heading_rad = measured.attitude.heading_rad + radians(condition.heading_off_deg) +
                            radians(condition.deviation_deg) * std::sin(truth.attitude.heading_rad + abeam);
    telemetry.pitch_rad = measured.attitude.pitch_rad;
    telemetry.roll_rad = measured.attitude.roll_rad;
    if (condition.imu) telemetry.imu_dv_mps = measured.imu_dv_mps;
    const double begin_ms = cpu_ms();
    const FrameReport report = localizer.process(picture, telemetry);
    record.cpu_ms += cpu_ms() - begin_ms;
    judge(report, truth, false, record);
    losses.see(report, i == 0, record);
    const auto off = error_m(report.estimate, truth);
    if (off) record.error_sum_m += *off;
    record.within_20 += off && *off < 20;
    record.within_50 += off && *off < 50;
    if (talk) talk(frame_line(i, report, truth));
  }
  const std::vector<Estimate> refined = localizer.refined();
  for (std::size_t i = 0; i < refined.size(); ++i) {
    FrameReport after;
    after.estimate = refined[i];
    Record judged;
    judge(after, truths[i], false, judged);
    record.refined_in_95 += judged.in_95;
    const auto off = error_m(refined[i], truths[i]);
    record.refined_within_20 += off && *off < 20;
    record.refined_within_50 += off && *off < 50;
  }
  return record;
}

namespace {

constexpr std::array kCounts = {
    &LongRecord::within_20,     &LongRecord::within_50, &LongRecord::refined_within_20, &LongRecord::refined_within_50,
    &LongRecord::refined_in_95, &LongRecord::losses,    &LongRecord::recovered,         &LongRecord::longest_recovery};

double percent(int part, int whole) { return whole == 0 ? 0 : 100.0 * part / whole; }

void add(LongRecord& sum, const LongRecord& r) {
  ++sum.index;  // of a sum: how many flights
  for (const auto count :
       {&Record::frames, &Record::attempts, &Record::accepted, &Record::wrong, &Record::anchored, &Record::misleading,
        &Record::positioned, &Record::overconfident, &Record::in_50, &Record::in_95}) {
    sum.*count += r.*count;
  }
  const int longest = std::max(sum.longest_recovery, r.longest_recovery);
  for (const auto count : kCounts) sum.*count += r.*count;
  sum.longest_recovery = longest;
  sum.error_sum_m += r.error_sum_m;
  sum.cpu_ms += r.cpu_ms;
  sum.worst_m = std::max(sum.worst_m, r.worst_m);
  sum.worst_sigmas = std::max(sum.worst_sigmas, r.worst_sigmas);
}

std::string row(const LongRecord& s) {
  return fmt::format(
      "| {} | {} | {:.1f} | {:.1f} | {:.1f} | {:.1f} | {} | {} | {} | {:.1f} | {:.1f} | {} of {} | {} | {:.1f}, {:.1f} "
      "| "
      "{:.1f} | {:.0f} |\n",
      s.condition, s.index, percent(s.within_20, s.frames), percent(s.within_50, s.frames),
      s.positioned == 0 ? 0 : s.error_sum_m / s.positioned, percent(s.accepted, s.attempts), s.wrong, s.misleading,
      s.overconfident, percent(s.in_50, s.positioned), percent(s.in_95, s.positioned), s.recovered, s.losses,
      s.longest_recovery, percent(s.refined_within_20, s.frames), percent(s.refined_within_50, s.frames),
      percent(s.refined_in_95, s.frames), s.cpu_ms / std::max(1, s.frames));
}

}  // namespace

std::string long_header(std::uint64_t base_seed, int worlds, int frames, const std::string& second) {
  return fmt::format(
      "# nadir bench flights, base seed {}, {} worlds, {} frames{}\n"
      "index,condition,frames,attempts,accepted,wrong,anchored,misleading,unknowable,told,overconfident,in_50,in_95,"
      "nees,worst_sigmas,worst_m,levels,within_20,within_50,refined_within_20,refined_within_50,refined_in_95,losses,"
      "recovered,longest_recovery,error_sum_m,cpu_ms\n",
      base_seed, worlds, frames, second);
}

std::string line(const LongRecord& r) {
  std::string text = line(static_cast<const Record&>(r));
  text.pop_back();
  for (const auto count : kCounts) text += fmt::format(",{}", r.*count);
  return text + fmt::format(",{:.2f},{:.0f}\n", r.error_sum_m, r.cpu_ms);
}

LongRecord long_record_of(const std::string& text) {
  LongRecord r;
  static_cast<Record&>(r) = record_of(text);
  std::istringstream in(text);
  std::vector<std::string> cells;
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
  constexpr std::size_t kCommon = 17;
  if (cells.size() != kCommon + kCounts.size() + 2) {
    throw Error({.what = "a line of results cannot be read", .found = text});
  }
  for (std::size_t i = 0; i < kCounts.size(); ++i) r.*kCounts[i] = std::stoi(cells[kCommon + i]);
  r.error_sum_m = std::stod(cells[cells.size() - 2]);
  r.cpu_ms = std::stod(cells.back());
  return r;
}

std::string long_summary(const std::map<std::uint64_t, LongRecord>& records) {
  std::string text =
      "| condition | flights | < 20 m % | < 50 m % | mean m | anchored % | wrong | misleading | overconfident | in 50 "
      "% "
      "| in 95 % | recovered | after frames | refined < 20 m, < 50 m % | refined in 95 % | CPU ms a frame |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  std::vector<LongRecord> sums;
  LongRecord all;
  all.condition = "all";
  for (const auto& [index, record] : records) {
    const auto same = [&](const LongRecord& sum) { return sum.condition == record.condition; };
    auto sum = std::find_if(sums.begin(), sums.end(), same);
    if (sum == sums.end()) {
      sums.emplace_back().condition = record.condition;
      sum = std::prev(sums.end());
    }
    add(*sum, record), add(all, record);
  }
  for (const LongRecord& sum : sums) text += row(sum);
  return text + row(all);
}

}  // namespace nadir::bench
