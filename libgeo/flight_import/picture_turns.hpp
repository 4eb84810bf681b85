// Turns that pictures show: by how much the heading changed from one picture of the ground to the next. The change is
// the rotation between the two pictures (SIFT features, a similarity by RANSAC); where they do not overlap, or look far
// from nadir, nothing is seen. Accurate to about a degree, and independent of the camera's focal length.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "base/progress.hpp"
#include "flight_import/clock_offset.hpp"

namespace nadir {

// Grey images of one size, a few hundred pixels across. Clockwise turns of the aircraft are positive.
std::optional<double> turn_between(const cv::Mat& before, const cv::Mat& now);

struct TimedPicture {
  std::filesystem::path file;
  double time_s = 0;
};

// Of neighbouring pictures; of long flights an even choice of pairs. Pictures that cannot be read show nothing.
std::vector<SeenTurn> seen_turns(const std::vector<TimedPicture>& pictures, Progress& progress);

}  // namespace nadir
