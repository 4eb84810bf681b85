// What is kept of a picture to find tie points: the strongest SIFT features that are spread over it, at a reduced size.
//
// All features of a flight are in memory at once, because cross strips show the same ground hours later: 100 kB a
// frame, 300 MB for 3000. So descriptors are bytes, and each cell of a grid gives its strongest features first: a town
// in a corner of fields must not take all places, as points in one corner determine no attitude.
#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <span>
#include <vector>

#include "vision/camera.hpp"

namespace nadir {

struct TieFeatures {
  static constexpr std::size_t kLength = 128;

  std::vector<cv::Point2f> points;        // pixels of tie_camera()
  std::vector<std::uint8_t> descriptors;  // kLength of each, one after the other

  std::size_t size() const { return points.size(); }
  const std::uint8_t* descriptor(std::size_t i) const { return descriptors.data() + i * kLength; }
};

// The camera at the size at which pictures are compared and observations count: at most kWorkingSide_px.
CameraModel tie_camera(const CameraModel& camera);

// grey: CV_8UC1 of any size of the camera's shape, or empty. None when it shows nothing. camera: tie_camera().
TieFeatures tie_features(const cv::Mat& grey, const CameraModel& camera);

}  // namespace nadir
