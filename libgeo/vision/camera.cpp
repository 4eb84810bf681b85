#include "vision/camera.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <string_view>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/yaml.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

// Brown-Conrady: where the undistorted image point (x, y) at z = 1 appears.
Eigen::Vector2d distort(const std::array<double, 5>& d, const Eigen::Vector2d& point) {
  const double x = point.x(), y = point.y();
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
  return {x * radial + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x),
          y * radial + d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y};
}

// Derivative of the distorted point with respect to the undistorted one.
Eigen::Matrix2d distortion_jacobian(const std::array<double, 5>& d, const Eigen::Vector2d& point) {
  const double x = point.x(), y = point.y();
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
  const double growth = 2 * (d[0] + r2 * (2 * d[1] + r2 * 3 * d[4]));  // of `radial` with r2, doubled
  const double mixed = x * y * growth + 2 * d[2] * x + 2 * d[3] * y;
  Eigen::Matrix2d jacobian;
  jacobian << radial + x * x * growth + 2 * d[2] * y + 6 * d[3] * x, mixed,  //
      mixed, radial + y * y * growth + 6 * d[2] * y + 2 * d[3] * x;
  return jacobian;
}

// A barrel lens' polynomial turns back far outside of the image. The share of the way to `point` up to which the
// distorted point still moves outwards.
double share_before_fold(const std::array<double, 5>& d, const Eigen::Vector2d& point) {
  const double r2 = point.squaredNorm();
  const auto outwards = [&](double share) {
    const double s = share * share * r2;
    return 1 + s * (3 * d[0] + s * (5 * d[1] + s * 7 * d[4])) > 0;
  };
  for (int i = 1; i <= kFoldProbes; ++i) {
    double before = (i - 1.0) / kFoldProbes, after = static_cast<double>(i) / kFoldProbes;
    if (outwards(after)) continue;
    for (int halving = 0; halving < kFoldBisections; ++halving) {
      const double middle = 0.5 * (before + after);
      (outwards(middle) ? before : after) = middle;
    }
    return before;
  }
  return 1;
}

double positive(const YamlNode& node) {
  const double value = node.number();
  if (!(value > 0)) node.reject("a number above 0");
  return value;
}

bool is_true(const YamlNode& node) {
  const std::string text = node.text();
  if (text != "true" && text != "false") node.reject("true or false");
  return text == "true";
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

// The lens must stay one-to-one inside the image, else a pixel would have two rays.
void check_invertible(const CameraModel& camera, const YamlNode& node) {
  for (int i = 0; i <= kInvertibilitySteps; ++i) {
    for (int j = 0; j <= kInvertibilitySteps; ++j) {
      const Eigen::Vector2d pixel((camera.width - 1.0) * i / kInvertibilitySteps,
                                  (camera.height - 1.0) * j / kInvertibilitySteps);
      const Eigen::Vector2d back = camera.pixel_from_point(camera.ray_from_pixel(pixel));
      if (!((back - pixel).norm() < kInvertibilityError_px)) {
        node.reject("a distortion that can be inverted over the whole image");
      };
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

using Direction = SensorReadout::Direction;
constexpr std::array kDirections{Direction::down, Direction::up, Direction::right, Direction::left};

int lines_of(const CameraModel& camera, Direction direction) {
  return direction == Direction::down || direction == Direction::up ? camera.height : camera.width;
}

SensorReadout read_readout(const YamlNode& node, const CameraModel& camera) {
  node.allow_only({"row_time_s", "direction"});
  SensorReadout readout;
  if (const auto direction = node.optional("direction")) {
    const std::string name = direction->text();
    const auto* known = std::ranges::find(kDirections, name, [](Direction one) { return name_of(one); });
    if (known == kDirections.end()) direction->reject("down, up, right or left");
    readout.direction = *known;
  }
  const YamlNode row_time = node.required("row_time_s");
  readout.duration_s = positive(row_time) * lines_of(camera, readout.direction);
  if (readout.duration_s > kMaxReadout_s)
    row_time.reject("seconds from one row to the next, at most 0.2 s for all of them");
  return readout;
}

constexpr std::string_view kFormat = "nadir.airframe/1";
constexpr double kLongestDelay_s = 5;
constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 20;
constexpr std::int64_t kMaxAirframeSequence = 1'000'000'000;

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

constexpr std::size_t kMostParameters = 64;
constexpr std::size_t kLongestParameterName = 16;  // of PARAM_VALUE

std::vector<AirframeParameter> read_parameters(const YamlNode& node) {
  std::vector<AirframeParameter> parameters;
  for (const YamlNode& item : node.items()) {
    if (parameters.size() == kMostParameters) node.reject(std::to_string(kMostParameters) + " parameters at most");
    item.allow_only({"name", "value"});
    const YamlNode name = item.required("name");
    const std::string text = name.text();
    const bool plain = std::ranges::all_of(text, [](unsigned char c) { return std::isalnum(c) != 0 || c == '_'; });
    if (text.empty() || text.size() > kLongestParameterName || !plain) {
      name.reject("a parameter's name of at most 16 letters, digits and '_'");
    }
    parameters.push_back({text, item.required("value").number()});
  }
  return parameters;
}

void read_link(const YamlNode& node, Airframe& airframe) {
  node.allow_only({"system", "autopilot", "component", "link", "gps_id", "parameters"});
  if (const auto value = node.optional("system")) airframe.system = number_of(*value, 1);
  if (const auto value = node.optional("autopilot")) airframe.autopilot = number_of(*value, 1);
  if (const auto value = node.optional("component")) airframe.component = number_of(*value, 1);
  if (const auto value = node.optional("link")) airframe.link = number_of(*value, 0);
  if (const auto value = node.optional("gps_id")) airframe.gps_id = number_of(*value, 0);
  if (const auto list = node.optional("parameters")) airframe.parameters = read_parameters(*list);
}

std::string read_id(const YamlNode& node) {
  const std::string id = node.text();
  const bool plain =
      std::ranges::all_of(id, [](unsigned char c) { return std::isalnum(c) != 0 || c == '-' || c == '_'; });
  if (id.empty() || id.size() > 64 || !plain) node.reject("a name of at most 64 letters, digits, '-' and '_'");
  return id;
}

// The attitude whose enu_from_camera() is rotation * enu_from_camera({}).
Attitude attitude_from_rotation(const Eigen::Matrix3d& rotation) {
  Eigen::Matrix3d enu_from_ned;
  enu_from_ned << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  const Eigen::Matrix3d r = enu_from_ned.transpose() * rotation * enu_from_ned;
  return {std::atan2(r(1, 0), r(0, 0)), std::asin(std::clamp(-r(2, 0), -1.0, 1.0)), std::atan2(r(2, 1), r(2, 2))};
}

}  // namespace

Eigen::Vector2d CameraModel::pixel_from_point(const Eigen::Vector3d& point) const {
  Eigen::Vector2d image = point.head<2>() / point.z();
  if (distorted()) {
    const Eigen::Vector2d one_to_one = share_before_fold(distortion, image) * image;
    image += distort(distortion, one_to_one) - one_to_one;  // beyond the fold, straight on
  }
  return {fx * image.x() + cx, fy * image.y() + cy};
}

Eigen::Vector3d CameraModel::ray_from_pixel(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d observed((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  Eigen::Vector2d image = observed;
  if (distorted()) {
    for (int i = 0; i < kUndistortIterations; ++i) {  // Newton
      const Eigen::Vector2d error = distort(distortion, image) - observed;
      image -= distortion_jacobian(distortion, image).inverse() * error;
      if (error.squaredNorm() < kUndistortError2) break;
    }
  }
  return {image.x(), image.y(), 1.0};
}

CameraModel CameraModel::scaled(double factor) const {
  CameraModel result = *this;
  result.width = std::max(1, static_cast<int>(std::lround(width * factor)));
  result.height = std::max(1, static_cast<int>(std::lround(height * factor)));
  const double sx = static_cast<double>(result.width) / width;
  const double sy = static_cast<double>(result.height) / height;
  result.fx = fx * sx;
  result.fy = fy * sy;
  result.cx = (cx + 0.5) * sx - 0.5;  // pixel centres are at whole numbers
  result.cy = (cy + 0.5) * sy - 0.5;
  return result;
}

std::string_view name_of(SensorReadout::Direction direction) {
  switch (direction) {
    case Direction::down: return "down";
    case Direction::up: return "up";
    case Direction::right: return "right";
    case Direction::left: return "left";
  }
  return "down";
}

double CameraFile::line_time_s() const {
  return readout ? readout->duration_s / lines_of(camera, readout->direction) : 0;
}

Eigen::Matrix3d enu_from_camera(const Attitude& attitude) {
  const double ch = std::cos(attitude.heading_rad), sh = std::sin(attitude.heading_rad);
  const double cp = std::cos(attitude.pitch_rad), sp = std::sin(attitude.pitch_rad);
  const double cr = std::cos(attitude.roll_rad), sr = std::sin(attitude.roll_rad);
  // North-east-down from body (forward, right, down), yaw-pitch-roll.
  Eigen::Matrix3d ned_from_body;
  ned_from_body << ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr,  //
      sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr,               //
      -sp, cp * sr, cp * cr;
  Eigen::Matrix3d enu_from_ned, body_from_camera;
  enu_from_ned << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  body_from_camera << 0, -1, 0, 1, 0, 0, 0, 0, 1;  // image-up is forward, image-right is right
  return enu_from_ned * ned_from_body * body_from_camera;
}

CameraFile read_camera_file(const std::filesystem::path& path) { return read_camera(YamlNode::read(path)); }

CameraFile read_camera(const YamlNode& root) {
  root.allow_only({"model", "width", "height", "fx", "fy", "cx", "cy", "distortion", "uncertainty", "rolling_shutter",
                   "on_gimbal"});
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
  if (const auto shutter = root.optional("rolling_shutter")) file.readout = read_readout(*shutter, file.camera);
  if (const auto gimbal = root.optional("on_gimbal")) file.on_gimbal = is_true(*gimbal);
  return file;
}

Airframe read_airframe(const std::filesystem::path& path) {
  return parse_airframe(read_text_file(path, kMostBytes), path.string());
}

Airframe parse_airframe(std::string_view text, std::string_view name) {
  const YamlNode root = YamlNode::parse(text, name);  // JSON is YAML
  root.allow_only({"format", "airframe", "sequence", "expires", "camera", "mount", "gimbal", "capture_delay_s",
                   "matcher", "mavlink"});
  if (root.required("format").text() != kFormat) root.required("format").reject("\"nadir.airframe/1\"");
  Airframe airframe;
  airframe.id = read_id(root.required("airframe"));
  if (const auto sequence = root.optional("sequence")) {
    airframe.sequence = sequence->integer();
    if (*airframe.sequence < 1 || *airframe.sequence > kMaxAirframeSequence) {
      sequence->reject("a whole number from 1 to " + std::to_string(kMaxAirframeSequence));
    }
  }
  if (const auto expires = root.optional("expires")) {
    airframe.expires = parse_utc(expires->text());
    if (!airframe.expires) expires->reject("a time as 2030-01-01T00:00:00Z");
  }
  airframe.camera = read_camera(root.required("camera"));
  if (const auto mount = root.optional("mount")) {
    mount->allow_only({"yaw_deg", "pitch_deg", "roll_deg"});
    airframe.mount = {angle(*mount, "yaw_deg", 360), angle(*mount, "pitch_deg", 45), angle(*mount, "roll_deg", 45)};
  }
  if (const auto gimbal = root.optional("gimbal")) {
    gimbal->allow_only({"component", "device"});
    airframe.gimbal.emplace();
    if (const auto value = gimbal->optional("component")) airframe.gimbal->component = number_of(*value, 1);
    if (const auto value = gimbal->optional("device")) airframe.gimbal->device = number_of(*value, 0);
    airframe.camera.on_gimbal = true;
  } else if (airframe.camera.on_gimbal) {
    root.reject("\"gimbal\", whose attitude the camera has: it is on_gimbal");
  }
  if (const auto delay = root.optional("capture_delay_s")) {
    airframe.capture_delay_s = delay->number();
    if (!(airframe.capture_delay_s >= 0) || airframe.capture_delay_s > kLongestDelay_s) {
      delay->reject("seconds from 0 to 5");
    }
  }
  if (const auto matcher = root.optional("matcher")) {
    matcher->allow_only({"model", "sha256"});
    airframe.matcher.emplace();
    airframe.matcher->model = matcher->required("model").text();
    if (airframe.matcher->model.empty()) matcher->required("model").reject("the name of an ONNX file");
    const auto digest = Sha256::from_hex(matcher->required("sha256").text());
    if (!digest) matcher->required("sha256").reject("64 lower-case hexadecimal digits");
    airframe.matcher->sha256 = *digest;
  }
  if (const auto link = root.optional("mavlink")) read_link(*link, airframe);
  return airframe;
}

Attitude camera_attitude(const Attitude& aircraft, const Attitude& mount) {
  if (mount.heading_rad == 0 && mount.pitch_rad == 0 && mount.roll_rad == 0) return aircraft;
  // enu_from_camera({}) takes the camera frame to the axes of a body that points north.
  const Eigen::Matrix3d north_body = enu_from_camera({});
  const Eigen::Matrix3d rotation =
      enu_from_camera(aircraft) * north_body.transpose() * enu_from_camera(mount) * north_body.transpose();
  return attitude_from_rotation(rotation);
}

Attitude camera_attitude_on_gimbal(const Eigen::Matrix3d& ned_from_gimbal, const Attitude& mount) {
  Eigen::Matrix3d enu_from_ned, gimbal_from_camera;
  enu_from_ned << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  gimbal_from_camera << 0, 0, 1, 1, 0, 0, 0, 1, 0;  // it looks along its x axis, y is right, z down the image
  const Eigen::Matrix3d north_body = enu_from_camera({});
  return camera_attitude(
      attitude_from_rotation(enu_from_ned * ned_from_gimbal * gimbal_from_camera * north_body.transpose()), mount);
}

Eigen::Vector3d camera_rate(const Eigen::Vector3d& aircraft_rad_s, const Attitude& mount) {
  const Eigen::Vector3d& a = aircraft_rad_s;
  const Eigen::Vector3d rate =
      enu_from_camera(mount).transpose() * enu_from_camera({}) * Eigen::Vector3d(a.y(), -a.x(), a.z());
  return {-rate.y(), rate.x(), rate.z()};
}

Eigen::Vector3d camera_rate(const Attitude& before, const Attitude& after, double seconds) {
  const Eigen::AngleAxisd turn(enu_from_camera(before).transpose() * enu_from_camera(after));
  const Eigen::Vector3d rate = turn.axis() * (turn.angle() / seconds);
  return {-rate.y(), rate.x(), rate.z()};
}

Attitude aircraft_attitude(const Attitude& camera, const Attitude& mount) {
  if (mount.heading_rad == 0 && mount.pitch_rad == 0 && mount.roll_rad == 0) return camera;
  return attitude_from_rotation(enu_from_camera(camera) * enu_from_camera(mount).transpose());
}

}  // namespace nadir
