// A camera's name by what it is: SHA-256 of its canonical form, JSON with sorted keys, no blanks and whole numbers
// (docs/formats/candidates.md), so that tiles of one lens can be told from those of another.
#pragma once

#include <string>

#include "base/sha256.hpp"
#include "vision/camera.hpp"

namespace nadir {

std::string canonical_camera(const CameraModel& camera);
Sha256 camera_digest(const CameraModel& camera);

}  // namespace nadir
