// Tie points of a flight from its pictures: what the block adjustment joins the frames by.
//
//   1. features of each picture (tie_features.hpp)
//   2. pairs to compare: each frame with the next two, and with those of other passes over the same ground, by the
//   poses
//      that are known so far; of each pass the nearest, of all passes a bounded number
//   3. matches of each pair, where the poses expect them, that agree on one homography (tie_matching.hpp)
//   4. points, and a well-spread subset of them (tie_tracks.hpp)
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "base/progress.hpp"
#include "flight_adjustment/tie_tracks.hpp"
#include "vision/ground_surface.hpp"
#include "vision/rectification.hpp"

namespace nadir {

// What is known of a frame's pose before.
struct TieFrame {
  CameraPose pose;
  double position_sigma_m = 0;  // one axis
  double tilt_sigma_rad = 0, heading_sigma_rad = 0;
  double log_height_sigma = 0;
  bool continues_flight = false;  // odometry tracked it from the frame before
};

struct TiePoints {
  CameraModel camera;  // tie_camera(), of the observations' pixels
  struct Observation {
    std::size_t frame = 0;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  };
  std::vector<std::vector<Observation>> points;  // by frame, each frame at most once
  std::size_t pairs_compared = 0, pairs_matched = 0;
};

// CV_8UC1 in the camera's shape; empty: this frame has no picture, and no tie points.
using FrameImageOf = std::function<cv::Mat(std::size_t frame)>;

// Pairs (a, b), a < b, in order.
std::vector<std::pair<std::size_t, std::size_t>> pairs_to_compare(const CameraModel& camera,
                                                                  std::span<const TieFrame> frames);

// Throws Interrupted, and what image_of throws. Progress counts frames.
TiePoints find_tie_points(const CameraModel& camera, const GroundSurface& ground, std::span<const TieFrame> frames,
                          const FrameImageOf& image_of, Progress& progress, const Cancel& cancel = {});

}  // namespace nadir
