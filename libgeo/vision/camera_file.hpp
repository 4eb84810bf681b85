// A camera inside a larger document. For files of their own: read_camera_file() in camera_model.hpp.
#pragma once

#include "base/yaml.hpp"
#include "vision/camera_model.hpp"

namespace nadir {

CameraFile read_camera(const YamlNode& root);  // throws UsageError with file, line and column

}  // namespace nadir
