// The parts of the service run here as nadird runs them: OpenCV has no threads of its own.
#include <gtest/gtest.h>

#include <opencv2/core/utility.hpp>

namespace nadir {
namespace {

class AsNadird final : public ::testing::Environment {
  void SetUp() override { cv::setNumThreads(1); }
};

const auto* const kAsNadird = ::testing::AddGlobalTestEnvironment(new AsNadird);

}  // namespace
}  // namespace nadir
