// What is wrong with a candidate as its sidecar describes it, before any byte of its picture has come.
//
// Signatures are checked first by whoever calls: a sidecar that nobody vouches for says nothing.
#pragma once

#include <optional>

#include "candidates/candidate_rules.hpp"
#include "candidates/catalogue_rows.hpp"

namespace nadir {

// The first reason for refusing it, in the order in which an operator would want to hear them.
// announced_at: when its batch says that it was made.
std::optional<Refusal> judge_announced(const CandidateSidecar& sidecar, UtcTime announced_at, UtcTime now,
                                       const CandidateRules& rules);

// How far a tile's worst corner lies off the vertical below the camera; the uncertainty of the pose is on the tile's
// side. Flat ground.
double view_angle_rad(const CandidateSidecar& sidecar, double sigmas);

}  // namespace nadir
