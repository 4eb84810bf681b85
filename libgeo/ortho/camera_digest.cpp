#include "ortho/camera_digest.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

namespace nadir {

std::string canonical_camera(const CameraModel& camera) {
  const auto scaled = [](double value, double unit) { return static_cast<std::int64_t>(std::llround(value / unit)); };
  nlohmann::json distortion = nlohmann::json::array();
  for (const double coefficient : camera.distortion) distortion.push_back(scaled(coefficient, 1e-9));
  const nlohmann::json document{{"schema", "nadir.camera/1"},       {"width", camera.width},
                                {"height", camera.height},          {"fx_e6", scaled(camera.fx, 1e-6)},
                                {"fy_e6", scaled(camera.fy, 1e-6)}, {"cx_e6", scaled(camera.cx, 1e-6)},
                                {"cy_e6", scaled(camera.cy, 1e-6)}, {"distortion_e9", distortion}};
  return document.dump();
}

Sha256 camera_digest(const CameraModel& camera) { return sha256(as_bytes(canonical_camera(camera))); }

}  // namespace nadir
