// While this lives OpenCV works in the calling thread alone: whoever shares work out among threads does not want more
// of them below each.
#pragma once

#include <opencv2/core/utility.hpp>

namespace nadir {

class OneOpenCvThread {
 public:
  OneOpenCvThread() : before_(cv::getNumThreads()) { cv::setNumThreads(1); }
  ~OneOpenCvThread() { cv::setNumThreads(before_); }
  OneOpenCvThread(const OneOpenCvThread&) = delete;
  OneOpenCvThread& operator=(const OneOpenCvThread&) = delete;

 private:
  int before_;
};

}  // namespace nadir
