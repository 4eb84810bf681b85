// While this lives, OpenCV works in the calling thread only: for code that distributes its work over threads itself.
#pragma once

#include <opencv2/core/utility.hpp>

namespace nadir {

class SingleOpenCvThread {
 public:
  SingleOpenCvThread() : before_(cv::getNumThreads()) { cv::setNumThreads(1); }
  ~SingleOpenCvThread() { cv::setNumThreads(before_); }
  SingleOpenCvThread(const SingleOpenCvThread&) = delete;
  SingleOpenCvThread& operator=(const SingleOpenCvThread&) = delete;

 private:
  int before_;
};

}  // namespace nadir
