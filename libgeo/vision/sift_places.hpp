// Which place of a map window the SIFT features of a rectified frame speak for.
#pragma once

#include <opencv2/core/types.hpp>
#include <vector>

#include "vision/feature_matching.hpp"
#include "vision/place_search.hpp"

namespace nadir {

struct SiftFeatures {
  std::vector<cv::KeyPoint> points;
  FeatureDescriptors descriptors;
};

SiftFeatures sift_features(const cv::Mat& grey, const cv::Mat& mask, int most);

// The same points in the rectified frame and in the map window, in pixels. Many of them may be wrong.
struct SiftPairs {
  std::vector<cv::Point2f> frame, map;
};

SiftPairs sift_pairs(const SiftFeatures& frame, const SiftFeatures& map);

// OpenCV's pixels: the centre of one has whole numbers.
PlanePoint plane_of(const GroundGrid& grid, const cv::Point2f& pixel);
PlanePoint plane_of(const MapWindow& map, const cv::Point2f& pixel);

struct SiftPlaces {
  std::vector<Place> places;  // the score is the share of the pairs that agree
  double chance = 0;          // the score that any place reaches
};

// The place that most pairs agree on, and the one that most of those agree on that speak for another place. `frame` was
// rectified with the prior's pose; a place lies within the prior's window.
SiftPlaces sift_places(const SiftPairs& pairs, const RectifiedFrame& frame, const MapWindow& map,
                       const SearchPrior& prior, double distinct_m);

}  // namespace nadir
