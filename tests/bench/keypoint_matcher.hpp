// Map matchers that pair keypoints, which show that the interface is independent of the backend, and compare the
// channels with others (./run bench ablations, matchers). The contract of map_matcher.hpp is tested over SIFT's.
//
// Keypoints of the rectified frame among those of the map, and the place on which most of the pairs agree by a robust
// homography.
#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "vision/feature_matching.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

struct KeypointSet {
  std::vector<cv::Point2f> points;  // OpenCV's pixels: the centre of one has whole numbers
  cv::Mat descriptors;              // CV_32FC1, a row for each
};

// What finds keypoints, and pairs those of two pictures that look alike.
class KeypointBackend {
 public:
  virtual ~KeypointBackend() = default;
  // grey: CV_8UC1; none where the mask is 0; at most so many.
  virtual KeypointSet find(const cv::Mat& grey, const cv::Mat& mask, int most) = 0;
  virtual std::vector<FeatureMatch> pairs(const KeypointSet& frame, const KeypointSet& map) = 0;
  // A frame's longer side in pixels, at most: what is compared is coarser where the frame has more.
  virtual double most_frame_px() const = 0;
};

std::unique_ptr<MapMatcher> make_keypoint_matcher(const MatcherMap& map, std::shared_ptr<KeypointBackend> backend);

// For images of one season: across seasons it recognises few places.
std::unique_ptr<MapMatcher> make_sift_matcher(const MatcherMap& map);

}  // namespace nadir
