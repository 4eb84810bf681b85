// The localizer's result for one frame, compared with the truth.
#pragma once

#include <span>

#include "estimation/estimate.hpp"
#include "safety_record.hpp"
#include "vision/rectification.hpp"

namespace nadir::bench {

// How far the published position is from the truth, metres; nothing when none is published.
std::optional<double> error_m(const Estimate& estimate, const CameraPose& truth);

// unknowable: the fault cannot be detected with this map alone, and is counted separately.
void judge(const FrameReport& report, const CameraPose& truth, bool unknowable, Record& record);

// before: where the camera was at the frame before, and at the one before that: odometry may have gone over an outlier.
// A motion is wrong when it is farther from both than a wrong height or heading explains; by its length alone, so that
// a chance motion of about the right length counts as right.
void judge_motion(const OdometryReport& odometry, const CameraPose& truth, std::span<const CameraPose> before,
                  MotionCounts& motions);

// One line for people.
std::string frame_line(std::size_t frame, const FrameReport& report, const CameraPose& truth);

}  // namespace nadir::bench
