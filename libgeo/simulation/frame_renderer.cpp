#include "simulation/frame_renderer.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "vision/rolling_shutter.hpp"

namespace nadir {
namespace {

constexpr int kStep = 16;  // pixels between nodes
const cv::Vec2f kNoProjection(-1e6F, -1e6F);

// Bilinear between nodes, for one row of pixels.
void interpolate(const cv::Mat_<cv::Vec2f>& nodes, double scale, cv::Point origin, cv::Mat_<cv::Vec2f>& map) {
  const float left_edge = 0.5F + static_cast<float>(origin.x), top_edge = 0.5F + static_cast<float>(origin.y);
  for (int row = 0; row < map.rows; ++row) {
    const cv::Vec2f *a = nodes[row / kStep], *b = nodes[row / kStep + 1];
    const float t = static_cast<float>(row % kStep) / kStep;
    cv::Vec2f* out = map[row];
    for (int first = 0, c = 0; first < map.cols; first += kStep, ++c) {
      const cv::Vec2f left = a[c] + (b[c] - a[c]) * t, right = a[c + 1] + (b[c + 1] - a[c + 1]) * t;
      const cv::Vec2f slope = (right - left) * (1.0F / kStep);
      const int count = std::min(kStep, map.cols - first);
      const auto s = static_cast<float>(scale);
      for (int i = 0; i < count; ++i) {
        const cv::Vec2f p = left + slope * static_cast<float>(i);
        out[first + i] = {p[0] * s - left_edge, p[1] * s - top_edge};
      }
    }
  }
}

struct PixelBounds {
  double left = 1e12, right = -1e12, top = 1e12, bottom = -1e12;

  // Pixels between the nodes lie within the nodes' bounds; one pixel on every side allows for rounding in resampling.
  bool inside(const cv::Rect& part) const {
    return left >= part.x + 1 && top >= part.y + 1 && right <= part.br().x - 2 && bottom <= part.br().y - 2;
  }
};

PixelBounds bounds_of(const cv::Mat_<cv::Vec2f>& nodes, double scale) {
  PixelBounds bounds;
  for (const cv::Vec2f& node : nodes) {
    const double x = static_cast<double>(node[0]) * scale, y = static_cast<double>(node[1]) * scale;
    bounds.left = std::min(bounds.left, x), bounds.right = std::max(bounds.right, x);
    bounds.top = std::min(bounds.top, y), bounds.bottom = std::max(bounds.bottom, y);
  }
  return bounds;
}

cv::Rect covered_window(const PixelBounds& bounds, cv::Size size) {
  const auto& [left, right, top, bottom] = bounds;
  const int x0 = static_cast<int>(std::clamp(left - 4, 0.0, size.width - 1.0));
  const int y0 = static_cast<int>(std::clamp(top - 4, 0.0, size.height - 1.0));
  const int x1 = static_cast<int>(std::clamp(right + 4, x0 + 1.0, static_cast<double>(size.width)));
  const int y1 = static_cast<int>(std::clamp(bottom + 4, y0 + 1.0, static_cast<double>(size.height)));
  return {x0, y0, std::min(x1 - x0, 32000), std::min(y1 - y0, 32000)};
}

}  // namespace

Eigen::Vector3d intersect_ground(const GroundShape& ground, const Eigen::Vector3d& position,
                                 const Eigen::Vector3d& direction) {
  const Eigen::Vector3d d = direction.normalized();
  const double fall = std::max(-d.z(), 0.05);  // rays near the horizon end far away
  double up = ground.up_m(PlanePoint(position.head<2>()));
  Eigen::Vector3d point = position;
  double last_length = 0, last_gap = position.z() - up;
  double length = last_gap / fall;
  for (int i = 0; i < 30; ++i) {
    point = position + d * length;
    const double gap = position.z() - fall * length - ground.up_m(PlanePoint(point.head<2>()));
    if (std::abs(gap) < 1e-4) break;
    // Secant on the height above ground; falls back to the plane's step where the ground is level.
    const double slope = (gap - last_gap) / (length - last_length);
    const double next = std::abs(slope) > 0.2 * fall ? length - gap / slope : length + gap / fall;
    last_length = length, last_gap = gap;
    length = std::max(0.0, next);
    if (length == last_length) break;
  }
  return point;
}

FrameRenderer::FrameRenderer(const CameraModel& camera, const WorldRaster& world, const GroundShape& ground)
    : camera_(camera),
      world_(world),
      ground_(ground),
      nodes_((camera.width - 1) / kStep + 2, (camera.height - 1) / kStep + 2) {
  for (int r = 0; r < nodes_.height; ++r) {
    for (int c = 0; c < nodes_.width; ++c) rays_.push_back(camera.ray_from_pixel({c * kStep, r * kStep}));
  }
}

RenderedFrame FrameRenderer::render(const Eigen::Vector3d& position, const Attitude& attitude) const {
  const Eigen::Matrix3d rotation = enu_from_camera(attitude);
  std::vector<Eigen::Vector3d> points;
  points.reserve(rays_.size());
  for (const Eigen::Vector3d& ray : rays_) points.push_back(intersect_ground(ground_, position, rotation * ray));
  return resampled(std::move(points));
}

RenderedFrame FrameRenderer::render(const SensorReadout& readout,
                                    const std::function<CameraPlace(double seconds)>& at) const {
  std::vector<Eigen::Vector3d> points;
  points.reserve(rays_.size());
  for (std::size_t i = 0; i < rays_.size(); ++i) {
    const int row = static_cast<int>(i) / nodes_.width, column = static_cast<int>(i) % nodes_.width;
    const CameraPlace from = at(seconds_after_middle(camera_, readout, {column * kStep, row * kStep}));
    points.push_back(intersect_ground(ground_, from.position, from.world_from_camera * rays_[i]));
  }
  return resampled(std::move(points));
}

RenderedFrame FrameRenderer::resampled(std::vector<Eigen::Vector3d> points) const {
  world_.raster_from_enu(points);
  cv::Mat_<cv::Vec2f> nodes(nodes_);
  for (int r = 0; r < nodes.rows; ++r) {
    for (int c = 0; c < nodes.cols; ++c) {
      const Eigen::Vector3d& p = points[static_cast<std::size_t>(r * nodes.cols + c)];
      // Points outside of the projection's domain are never visible.
      nodes(r, c) = p.allFinite() ? cv::Vec2f(static_cast<float>(p.x()), static_cast<float>(p.y())) : kNoProjection;
    }
  }
  // Raster pixels per image pixel in the middle of the frame select the pyramid level.
  const int mr = nodes.rows / 2 - 1, mc = nodes.cols / 2 - 1;
  const cv::Vec2f dx = nodes(mr, mc + 1) - nodes(mr, mc), dy = nodes(mr + 1, mc) - nodes(mr, mc);
  const double area = std::abs(static_cast<double>(dx[0] * dy[1] - dx[1] * dy[0])) / (kStep * kStep);
  const double ratio = std::sqrt(std::max(area, 1e-12));
  const auto level =
      std::clamp<std::ptrdiff_t>(std::lround(std::log2(ratio) - 0.1), 0, std::ssize(world_.levels()) - 1);
  const WorldRaster::Level& source = world_.levels()[static_cast<std::size_t>(level)];

  cv::Mat_<cv::Vec2f> map(camera_.height, camera_.width);
  // Only the visible part: OpenCV resamples images of up to 32767 pixels a side.
  const double scale = std::ldexp(1.0, -static_cast<int>(level));
  const PixelBounds bounds = bounds_of(nodes, scale);
  const cv::Rect part = covered_window(bounds, source.image.size());
  interpolate(nodes, scale, part.tl(), map);
  cv::Mat fixed, fraction;
  cv::convertMaps(map, cv::noArray(), fixed, fraction, CV_16SC2);
  RenderedFrame frame;
  const int how = ratio < 0.9 ? cv::INTER_CUBIC : cv::INTER_LINEAR;
  cv::remap(source.image(part), frame.image, fixed, fraction, how, cv::BORDER_CONSTANT, cv::Scalar(96, 104, 100));
  if (source.whole && bounds.inside(part)) return frame;
  cv::Mat seen;
  cv::remap(source.mask(part), seen, fixed, cv::Mat(), cv::INTER_NEAREST, cv::BORDER_CONSTANT, cv::Scalar(0));
  frame.covered_fraction = cv::countNonZero(seen >= 128) / static_cast<double>(seen.total());
  if (frame.covered_fraction < 1) frame.image.setTo(cv::Scalar(96, 104, 100), seen < 128);
  return frame;
}

}  // namespace nadir
