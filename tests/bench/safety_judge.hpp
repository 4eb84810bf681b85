// What the localizer said of one frame, held against the truth.
#pragma once

#include "estimation/estimate.hpp"
#include "safety_record.hpp"
#include "vision/rectification.hpp"

namespace nadir::bench {

// How far the told position is from the truth, metres; nothing when none is told.
std::optional<double> error_m(const Estimate& estimate, const CameraPose& truth);

// unknowable: what is wrong cannot be known by whoever has only this map, and is counted apart.
void judge(const FrameReport& report, const CameraPose& truth, bool unknowable, Record& record);

// One line for people.
std::string told(std::size_t frame, const FrameReport& report, const CameraPose& truth);

}  // namespace nadir::bench
