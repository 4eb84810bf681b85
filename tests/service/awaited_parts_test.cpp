#include "service/awaited_parts.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace nadir {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

class Awaited : public ::testing::Test {
 protected:
  std::vector<std::string> until(double end_s) {
    std::vector<std::string> lines;
    for (; now_s_ < end_s; now_s_ += 0.5) {
      for (std::string& line : parts_.update(now_s_)) lines.push_back(std::move(line));
    }
    return lines;
  }

  double now_s_ = 100;
  bool camera_ = false, autopilot_ = true;
  std::string why_ = "folder /run/camera: no such folder";
  AwaitedParts parts_{{{"camera", [this](double) { return camera_; }, [this] { return "the camera (" + why_ + ")"; }},
                       {"autopilot", [this](double) { return autopilot_; }, [] { return "the autopilot"; }}}};
};

TEST_F(Awaited, ALineAtTheStartOneAMinuteAndOneWhenItComes) {
  EXPECT_THAT(until(101),
              ElementsAre("waiting for the camera (folder /run/camera: no such folder)", "autopilot: here"));
  EXPECT_THAT(until(160), IsEmpty());
  why_ = "no frame yet";
  EXPECT_THAT(until(221), ElementsAre("still waiting, for 60 s, for the camera (no frame yet)",
                                      "still waiting, for 120 s, for the camera (no frame yet)"));
  camera_ = true;
  EXPECT_THAT(until(400), ElementsAre("camera: here after 121 s"));
}

TEST_F(Awaited, WhatIsLostIsWaitedForAgain) {
  camera_ = true;
  EXPECT_THAT(until(101), ElementsAre("camera: here", "autopilot: here"));
  autopilot_ = false;
  EXPECT_THAT(until(110), ElementsAre("waiting for the autopilot"));
  autopilot_ = true;
  EXPECT_THAT(until(120), ElementsAre("autopilot: here after 9 s"));
}

}  // namespace
}  // namespace nadir
