// The localizer's result for one frame, compared with the truth.
#pragma once

#include "estimation/estimate.hpp"
#include "safety_record.hpp"
#include "vision/rectification.hpp"

namespace nadir::bench {

// How far the published position is from the truth, metres; nothing when none is published.
std::optional<double> error_m(const Estimate& estimate, const CameraPose& truth);

// unknowable: the fault cannot be detected with this map alone, and is counted separately.
void judge(const FrameReport& report, const CameraPose& truth, bool unknowable, Record& record);

// One line for people.
std::string frame_line(std::size_t frame, const FrameReport& report, const CameraPose& truth);

}  // namespace nadir::bench
