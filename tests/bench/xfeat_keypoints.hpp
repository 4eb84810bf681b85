// XFeat's keypoints (Potje and others, CVPR 2024) from its ONNX file, paired where each is the other's nearest: a
// backend of keypoint_matcher.hpp, to compare with the dense channels of the same network (./run bench matchers).
#pragma once

#include <filesystem>

#include "bench/keypoint_matcher.hpp"

namespace nadir {

// Throws Error where the model or the plug-in cannot be used.
std::shared_ptr<KeypointBackend> make_xfeat_keypoints(const std::filesystem::path& model,
                                                      const std::vector<std::filesystem::path>& plugins);

}  // namespace nadir
