#include <cmath>

#include "base/error.hpp"
#include "base/yaml.hpp"
#include "geodesy/angles.hpp"
#include "vision/camera_file.hpp"

namespace nadir {
namespace {

double positive(const YamlNode& node) {
  const double value = node.number();
  if (!(value > 0)) node.reject("a number above 0");
  return value;
}

int pixels(const YamlNode& node) {
  const auto value = node.integer();
  if (value < 16 || value > 20000) node.reject("a number of pixels from 16 to 20000");
  return static_cast<int>(value);
}

std::array<double, 5> read_distortion(const YamlNode& node) {
  std::array<double, 5> distortion{};
  const auto items = node.items();
  if (items.size() != 0 && items.size() != 4 && items.size() != 5) {
    node.reject("no coefficients, or 4 or 5 of them: k1 k2 p1 p2 [k3]");
  }
  for (std::size_t i = 0; i < items.size(); ++i) distortion[i] = items[i].number();
  return distortion;
}

// The lens must stay one-to-one inside the picture, else a pixel would have two rays.
void check_invertible(const CameraModel& camera, const YamlNode& node) {
  constexpr int kSteps = 8;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const Eigen::Vector2d pixel((camera.width - 1.0) * i / kSteps, (camera.height - 1.0) * j / kSteps);
      const Eigen::Vector2d back = camera.pixel_from_point(camera.ray_from_pixel(pixel));
      if (!((back - pixel).norm() < 1e-3)) node.reject("a distortion that can be inverted over the whole picture");
    }
  }
}

TelemetryUncertainty read_uncertainty(const YamlNode& node) {
  node.allow_only({"heading_deg", "agl_relative", "tilt_deg", "imu_dv_mps"});
  TelemetryUncertainty uncertainty;
  uncertainty.heading_rad = radians(positive(node.required("heading_deg")));
  uncertainty.agl_relative = positive(node.required("agl_relative"));
  uncertainty.tilt_rad = radians(positive(node.required("tilt_deg")));
  if (const auto imu = node.optional("imu_dv_mps")) uncertainty.imu_dv_mps = positive(*imu);
  return uncertainty;
}

}  // namespace

CameraFile read_camera_file(const std::filesystem::path& path) { return read_camera(YamlNode::read(path)); }

CameraFile read_camera(const YamlNode& root) {
  root.allow_only({"model", "width", "height", "fx", "fy", "cx", "cy", "distortion", "uncertainty"});
  if (root.required("model").text() != "pinhole") root.required("model").reject("the model \"pinhole\"");
  CameraFile file;
  file.camera.width = pixels(root.required("width"));
  file.camera.height = pixels(root.required("height"));
  file.camera.fx = positive(root.required("fx"));
  file.camera.fy = positive(root.required("fy"));
  file.camera.cx = root.required("cx").number();
  file.camera.cy = root.required("cy").number();
  if (const auto distortion = root.optional("distortion")) {
    file.camera.distortion = read_distortion(*distortion);
    check_invertible(file.camera, *distortion);
  }
  if (const auto uncertainty = root.optional("uncertainty")) file.uncertainty = read_uncertainty(*uncertainty);
  return file;
}

}  // namespace nadir
