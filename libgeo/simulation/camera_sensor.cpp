#include "simulation/camera_sensor.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "simulation/noise.hpp"

namespace nadir {
namespace {

constexpr std::size_t kTable = 1U << 16;

// Convolves with a line of the motion's length and direction, sampled finely.
void blur_motion(cv::Mat& image, const Eigen::Vector2d& motion_px) {
  const double length = motion_px.norm();
  if (length < 0.25) return;
  const int reach = std::min(20, static_cast<int>(std::ceil(length / 2)) + 1), side = 2 * reach + 1;
  cv::Mat_<float> kernel(side, side, 0.F);
  constexpr int steps = 64;
  for (int i = 0; i <= steps; ++i) {
    const double t = static_cast<double>(i) / steps - 0.5;
    const double x = std::clamp(reach + t * motion_px.x(), 0.0, side - 1.001);
    const double y = std::clamp(reach + t * motion_px.y(), 0.0, side - 1.001);
    const int cx = static_cast<int>(x), cy = static_cast<int>(y);
    const auto fx = static_cast<float>(x - cx), fy = static_cast<float>(y - cy);
    kernel(cy, cx) += (1 - fx) * (1 - fy);
    kernel(cy, cx + 1) += fx * (1 - fy);
    kernel(cy + 1, cx) += (1 - fx) * fy;
    kernel(cy + 1, cx + 1) += fx * fy;
  }
  kernel /= cv::sum(kernel)[0];
  cv::filter2D(image, image, -1, kernel, cv::Point(-1, -1), 0, cv::BORDER_REPLICATE);
}

}  // namespace

CameraSensor::CameraSensor(cv::Size size, double focal_px, std::uint64_t seed) : vignette_(size), seed_(seed) {
  for (int row = 0; row < size.height; ++row) {
    for (int column = 0; column < size.width; ++column) {
      const double x = (column - size.width / 2.0) / focal_px, y = (row - size.height / 2.0) / focal_px;
      // The natural fall-off cos⁴, half of it corrected by the camera: cos² = 1 / (1 + tan²).
      vignette_(row, column) = static_cast<float>(1 / (1 + x * x + y * y));
    }
  }
  Random random = Random(seed).fork("sensor");
  normal_.reserve(kTable);
  for (std::size_t i = 0; i < kTable; ++i) normal_.push_back(static_cast<float>(random.normal()));
}

void CameraSensor::expose(cv::Mat& bgr, const Exposure& exposure, std::uint64_t frame) const {
  blur_motion(bgr, exposure.motion_px);
  const std::array<float, 3> gain = {static_cast<float>(exposure.gain * (1 - 0.03 * exposure.warmth)),
                                     static_cast<float>(exposure.gain),
                                     static_cast<float>(exposure.gain * (1 + 0.03 * exposure.warmth))};
  // Read noise and shot noise in display values: it grows with the square root of the light.
  std::array<float, 256> sigma{};
  for (std::size_t i = 0; i < sigma.size(); ++i) sigma[i] = 1.3F + 0.10F * std::sqrt(static_cast<float>(i));
  for (int row = 0; row < bgr.rows; ++row) {
    auto* pixel = bgr.ptr<cv::Vec3b>(row);
    const float* light = vignette_[row];
    std::uint64_t state = hash_of(seed_, static_cast<std::int64_t>(frame), row) | 1;
    for (int column = 0; column < bgr.cols; ++column) {
      state = state * 6364136223846793005ULL + 1442695040888963407ULL;
      const std::uint64_t bits = state >> 16;
      const float common = 0.6F * normal_[bits & 0xFFFF];
      for (int i = 0; i < 3; ++i) {
        const auto c = static_cast<std::size_t>(i);
        const float own = 0.8F * normal_[((bits >> 16) + 0x5555 * c + (bits >> (7 * c))) & 0xFFFF];
        const float value = static_cast<float>(pixel[column][i]) * light[column] * gain[c];
        const float noisy = value + sigma[pixel[column][i]] * (common + own);
        pixel[column][i] = static_cast<std::uint8_t>(std::clamp(noisy + 0.5F, 0.F, 255.F));
      }
    }
  }
}

namespace {

constexpr double kShutter_s = 1 / 800.0;

// Pixels that the ground moves in the image while the shutter is open.
Eigen::Vector2d motion_px(const CameraModel& camera, const FlightPose& pose, double shutter_s) {
  const double c = std::cos(pose.attitude.heading_rad), s = std::sin(pose.attitude.heading_rad);
  const double ahead = pose.velocity_mps.y() * c + pose.velocity_mps.x() * s,
               right = pose.velocity_mps.x() * c - pose.velocity_mps.y() * s;
  const double scale = shutter_s / pose.agl_m;
  return {-right * scale * camera.fx, ahead * scale * camera.fy};
}

}  // namespace

ExposureControl::ExposureControl(const CameraModel& camera, std::uint64_t seed)
    : camera_(camera), seed_(seed), light_(hash_of(seed, 31), 45) {}

Exposure ExposureControl::of(const FlightPose& pose, std::uint64_t frame) const {
  Exposure exposure;
  exposure.gain = 1.10 * (1 + 0.12 * light_.at(pose.time_s, 0.5) +
                          0.03 * (unit_hash(seed_, 32, static_cast<std::int64_t>(frame)) - 0.5));
  exposure.warmth = light_.at(pose.time_s, 400.5);
  exposure.motion_px = motion_px(camera_, pose, kShutter_s / exposure.gain);
  return exposure;
}

}  // namespace nadir
