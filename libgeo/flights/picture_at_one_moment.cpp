#include "flights/picture_at_one_moment.hpp"

#include "vision/camera_frame.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/rolling_shutter.hpp"

namespace nadir {
namespace {

ShutterMotion motion_of(const FlightStore& store, std::size_t frame) {
  const Telemetry telemetry = store.picture(frame).telemetry;
  ShutterMotion motion;
  motion.attitude = {telemetry.heading_rad.value_or(0), telemetry.pitch_rad.value_or(0),
                     telemetry.roll_rad.value_or(0)};
  motion.agl_m = telemetry.agl_m.value_or(parameters::localizer::kAssumedAgl_m);
  motion.rate_rad_s = telemetry.rate_rad_s.value_or(Eigen::Vector3d::Zero());
  if (frame < store.processed()) {
    const StateEstimate state = store.stored_frame(frame).online.state;
    motion.velocity_mps = state.velocity_mps;
    if (state.agl_m > 0) motion.agl_m = state.agl_m;
    if (!telemetry.heading_rad) motion.attitude.heading_rad = state.heading_rad;
  }
  return motion;
}

}  // namespace

cv::Mat picture_at_one_moment(const FlightStore& store, std::size_t frame, const CameraFile& camera, int shrink) {
  const cv::Mat as_read = decode_camera_frame(store.read_picture(frame), camera.camera, shrink);
  if (!camera.readout || as_read.empty()) return as_read;
  return without_rolling_shutter(as_read, camera.camera, *camera.readout, motion_of(store, frame));
}

Eigen::Vector2d pixel_at_one_moment(const FlightStore& store, std::size_t frame, const CameraFile& camera,
                                    const Eigen::Vector2d& as_read) {
  if (!camera.readout) return as_read;
  return pixel_at_one_moment(as_read, camera.camera, *camera.readout, motion_of(store, frame));
}

}  // namespace nadir
