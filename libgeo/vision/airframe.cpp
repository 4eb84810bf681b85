#include "vision/airframe.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "vision/camera_file.hpp"

namespace nadir {
namespace {

constexpr std::string_view kFormat = "nadir.airframe/1";
constexpr double kLongestDelay_s = 5;
constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 20;

std::uint8_t number_of(const YamlNode& node, std::int64_t least) {
  const auto value = node.integer();
  if (value < least || value > 255) node.reject("a number from " + std::to_string(least) + " to 255");
  return static_cast<std::uint8_t>(value);
}

double angle(const YamlNode& parent, std::string_view key, double most_deg) {
  const auto node = parent.optional(key);
  if (!node) return 0;
  const double value_deg = node->number();
  if (!(std::abs(value_deg) <= most_deg)) node->reject("degrees, at most " + std::to_string(std::lround(most_deg)));
  return radians(value_deg);
}

void read_link(const YamlNode& node, Airframe& airframe) {
  node.allow_only({"system", "autopilot", "component", "link", "gps_id"});
  if (const auto value = node.optional("system")) airframe.system = number_of(*value, 1);
  if (const auto value = node.optional("autopilot")) airframe.autopilot = number_of(*value, 1);
  if (const auto value = node.optional("component")) airframe.component = number_of(*value, 1);
  if (const auto value = node.optional("link")) airframe.link = number_of(*value, 0);
  if (const auto value = node.optional("gps_id")) airframe.gps_id = number_of(*value, 0);
}

std::string read_id(const YamlNode& node) {
  const std::string id = node.text();
  const bool plain =
      std::ranges::all_of(id, [](unsigned char c) { return std::isalnum(c) != 0 || c == '-' || c == '_'; });
  if (id.empty() || id.size() > 64 || !plain) node.reject("a name of at most 64 letters, digits, '-' and '_'");
  return id;
}

// Of turned * enu_from_camera({}): in north-east-down axes it is yaw, pitch, roll.
Attitude attitude_of(const Eigen::Matrix3d& turned) {
  Eigen::Matrix3d enu_from_ned;
  enu_from_ned << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  const Eigen::Matrix3d r = enu_from_ned.transpose() * turned * enu_from_ned;
  return {std::atan2(r(1, 0), r(0, 0)), std::asin(std::clamp(-r(2, 0), -1.0, 1.0)), std::atan2(r(2, 1), r(2, 2))};
}

}  // namespace

Airframe read_airframe(const std::filesystem::path& path) {
  return parse_airframe(read_text_file(path, kMostBytes), path.string());
}

Airframe parse_airframe(std::string_view text, std::string_view name) {
  const YamlNode root = YamlNode::parse(text, name);  // JSON is YAML
  root.allow_only({"format", "airframe", "camera", "mount", "capture_delay_s", "mavlink"});
  if (root.required("format").text() != kFormat) root.required("format").reject("\"nadir.airframe/1\"");
  Airframe airframe;
  airframe.id = read_id(root.required("airframe"));
  airframe.camera = read_camera(root.required("camera"));
  if (const auto mount = root.optional("mount")) {
    mount->allow_only({"yaw_deg", "pitch_deg", "roll_deg"});
    airframe.mount = {angle(*mount, "yaw_deg", 360), angle(*mount, "pitch_deg", 45), angle(*mount, "roll_deg", 45)};
  }
  if (const auto delay = root.optional("capture_delay_s")) {
    airframe.capture_delay_s = delay->number();
    if (!(airframe.capture_delay_s >= 0) || airframe.capture_delay_s > kLongestDelay_s) {
      delay->reject("seconds from 0 to 5");
    }
  }
  if (const auto link = root.optional("mavlink")) read_link(*link, airframe);
  return airframe;
}

Attitude camera_attitude(const Attitude& aircraft, const Attitude& mount) {
  if (mount.heading_rad == 0 && mount.pitch_rad == 0 && mount.roll_rad == 0) return aircraft;
  // Of a camera at heading zero, enu_from_camera(0) takes it to the body's axes laid north.
  const Eigen::Matrix3d north_laid = enu_from_camera({});
  const Eigen::Matrix3d turned =
      enu_from_camera(aircraft) * north_laid.transpose() * enu_from_camera(mount) * north_laid.transpose();
  return attitude_of(turned);
}

Attitude aircraft_attitude(const Attitude& camera, const Attitude& mount) {
  if (mount.heading_rad == 0 && mount.pitch_rad == 0 && mount.roll_rad == 0) return camera;
  return attitude_of(enu_from_camera(camera) * enu_from_camera(mount).transpose());
}

}  // namespace nadir
