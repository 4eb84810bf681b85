// Block adjustment of a drawn survey: time, memory, and whether the positions are as far off as they say.
// docs/adjustment.md.
#include <fmt/format.h>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>
#include <chrono>
#include <cmath>
#include <ctime>
#include <iostream>

#include "adjustment/drawn_block.hpp"
#include "adjustment/object_place.hpp"

using namespace nadir;
using namespace nadir::test;

namespace {

double now_s() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

double cpu_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

double peak_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024;
}

// Mean NEES over many small blocks: one large block is one draw of the errors that its frames share.
void print_small_blocks(int blocks, std::uint64_t seed) {
  double nees_2d = 0, nees_3d = 0;
  const RollingGround ground;
  for (int i = 0; i < blocks; ++i) {
    const DrawnBlockOptions options;
    const DrawnBlock block = draw_block(Random(seed).fork("block", static_cast<std::uint64_t>(i)), options, ground);
    BlockAdjustment adjustment(block.nominal, ground, block.options(options));
    block.add_to(adjustment);
    NoProgress progress;
    const BlockErrors errors = block_errors(adjustment.adjust(progress), block);
    nees_2d += errors.nees_2d / blocks;
    nees_3d += errors.nees_3d / blocks;
  }
  std::cout << fmt::format("{} blocks of 10 frames: NEES {:.2f} with 2 dof, {:.2f} with 3\n", blocks, nees_2d, nees_3d);
}

// The point with most observations, placed as an object.
void print_object(const AdjustedBlock& adjusted, const DrawnBlock& block, const GroundSurface& ground) {
  std::size_t best = 0;
  for (std::size_t j = 0; j < block.points.size(); ++j) {
    if (block.points[j].observations.size() > block.points[best].observations.size()) best = j;
  }
  std::vector<SightedFrame> frames;
  std::vector<ObjectSighting> sightings;
  std::vector<std::size_t> indices;
  for (const ImageObservation& o : block.points[best].observations) {
    const AdjustedFrame& frame = adjusted.frames[o.frame];
    if (!frame.covariance) continue;
    sightings.push_back({frames.size(), o.pixel});
    frames.push_back({frame.pose, *frame.covariance});
    indices.push_back(o.frame);
  }
  for (const std::size_t count : {std::size_t{1}, sightings.size(), std::size_t{32}}) {
    std::vector<ObjectSighting> some(count);
    for (std::size_t i = 0; i < count; ++i) some[i] = sightings[i % sightings.size()];
    const auto joint = adjusted.joint_covariance(indices);
    const double began = cpu_s();
    const auto result = place_object(adjusted.calibration.camera, ground, frames, some, 3, joint);
    const double ms = 1000 * (cpu_s() - began);
    const auto* object = std::get_if<LocatedObject>(&result);
    if (object == nullptr) continue;
    std::cout << fmt::format(
        "object from {} sightings: {:.2f} ms of CPU, 95 % within {:.1f} x {:.1f} m, {:.1f} m off\n", count, ms,
        object->ellipse_95.major_m, object->ellipse_95.minor_m,
        distance_m(object->place, {block.points_m[best].x(), block.points_m[best].y()}));
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Block adjustment of a drawn survey.", "adjustment");
  int frames = 3000, strips = 50, observations = 200'000, window = 50, blocks = 200;
  double wrong_anchors = 0.05, wrong_observations = 0.02;
  std::uint64_t seed = 1;
  app.add_option("--frames", frames, "of the survey")->check(CLI::Range(2, 100'000))->capture_default_str();
  app.add_option("--strips", strips, "that they are flown in")->check(CLI::Range(1, 10'000))->capture_default_str();
  app.add_option("--observations", observations, "of tie points")
      ->check(CLI::Range(0, 10'000'000))
      ->capture_default_str();
  app.add_option("--wrong-anchors", wrong_anchors, "share, 150 to 600 m off")->capture_default_str();
  app.add_option("--wrong-observations", wrong_observations, "share, up to 80 px off")->capture_default_str();
  app.add_option("--window", window, "frames of a window at the end")
      ->check(CLI::Range(1, 10'000))
      ->capture_default_str();
  app.add_option("--blocks", blocks, "small ones, for the mean NEES")
      ->check(CLI::Range(1, 100'000))
      ->capture_default_str();
  app.add_option("--seed", seed, "determines everything")->capture_default_str();
  CLI11_PARSE(app, argc, argv);

  const RollingGround ground;
  DrawnBlockOptions options;
  options.strips = strips;
  options.frames_per_strip = std::max(1, frames / strips);
  options.points_per_frame = observations / (options.strips * options.frames_per_strip);
  options.anchor_every = 5;
  options.wrong_anchor_share = wrong_anchors;
  options.wrong_observation_share = wrong_observations;
  const DrawnBlock block = draw_block(Random(seed), options, ground);
  BlockAdjustment adjustment(block.nominal, ground, block.options(options));
  block.add_to(adjustment);
  const double before_mb = peak_mb();
  NoProgress progress;
  const double began = now_s(), began_cpu = cpu_s();
  const AdjustedBlock adjusted = adjustment.adjust(progress);
  const double whole_s = now_s() - began, whole_cpu_s = cpu_s() - began_cpu, whole_mb = peak_mb();

  const BlockErrors errors = block_errors(adjusted, block);
  std::size_t wrong = 0, found = 0, right_off = 0;
  for (const AdjustedAnchor& anchor : adjusted.anchors) {
    wrong += block.wrong[anchor.anchor] ? 1U : 0U;
    found += block.wrong[anchor.anchor] && anchor.switched_off ? 1U : 0U;
    right_off += !block.wrong[anchor.anchor] && anchor.switched_off ? 1U : 0U;
  }
  double point_nees = 0, point_count = 0;
  for (std::size_t j = 0; j < adjusted.points.size(); ++j) {
    if (!adjusted.points[j].covariance_m2) continue;
    const Eigen::Vector3d error = adjusted.points[j].position_m - block.points_m[j];
    point_nees += error.dot(adjusted.points[j].covariance_m2->llt().solve(error));
    ++point_count;
  }
  std::cout << fmt::format(
      "| frames | observations | points | seconds | of CPU | iterations | MB | of the input | NEES, 2 dof | NEES, 3 "
      "dof "
      "| NEES of points, 3 dof | RMS m | worst m | reprojection px | wrong anchors off | right ones off | rejected |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n"
      "| {} | {} | {} | {:.1f} | {:.1f} | {} | {:.0f} | {:.0f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | "
      "{} of {} "
      "| {} of "
      "{} | {} |\n\n",
      adjusted.frames.size(), adjustment.observations(), block.points.size(), whole_s, whole_cpu_s, adjusted.iterations,
      whole_mb, before_mb, errors.nees_2d, errors.nees_3d, point_nees / point_count, errors.rms_m, errors.largest_m,
      adjusted.mean_reprojection_px, found, wrong, right_off, adjusted.anchors.size() - wrong,
      adjusted.rejected_observations);
  const auto& c = adjusted.calibration;
  std::cout << fmt::format(
      "focal length {:+.2f} % ± {:.2f} %, true {:+.2f} %; height scale {:+.2f} % ± {:.2f} %, true {:+.2f} %\n",
      100 * c.log_focal.value, 100 * c.log_focal.sigma, 100 * std::log(block.camera.fx / block.nominal.fx),
      100 * c.log_height_scale.value, 100 * c.log_height_scale.sigma, 100 * block.log_height_scale);
  const std::size_t count = adjustment.frames(), last = std::min(count, static_cast<std::size_t>(window));
  const double window_began = cpu_s();
  const AdjustedBlock tail = adjustment.adjust({count - last, count}, progress);
  std::cout << fmt::format("window of the last {} frames: {:.2f} s of CPU, {} iterations\n", last,
                           cpu_s() - window_began, tail.iterations);
  print_object(adjusted, block, ground);
  print_small_blocks(blocks, seed);
  return 0;
}
