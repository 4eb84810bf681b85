// A camera over a world that is kept in memory: a picture for any pose, fast enough for real time. film.hpp runs it.
//
// The local frame's origin is the world's centre, on the ground, so that a flight may go anywhere over it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "simulation/camera_sensor.hpp"
#include "simulation/exposure_control.hpp"
#include "simulation/frame_renderer.hpp"
#include "simulation/pose_source.hpp"
#include "simulation/world_extent.hpp"

namespace nadir {

struct LiveCameraOptions {
  std::filesystem::path world;
  std::optional<std::filesystem::path> dem;  // none: flat ground at ground_m
  double ground_m = 0;
  std::filesystem::path camera;
  std::uint64_t seed = 1;
  SensorNoise noise = SensorNoise::real;
};

class LiveCamera {
 public:
  // Reads the world and the heights. Throws Error or UsageError for inputs that cannot be used.
  explicit LiveCamera(const LiveCameraOptions& options);

  // The same pose and number give the same picture. A camera in the ground is lifted one metre over it; from farther
  // away than twenty kilometres above or beside the world, and beyond its edges, everything is grey.
  RenderedFrame shoot(const LivePose& pose, std::uint64_t number) const;

 private:
  LiveCamera(const LiveCameraOptions& options, const WorldExtent& extent);

  CameraModel camera_;
  SensorNoise noise_;
  PlaneBox box_;
  LocalFrame frame_;
  WorldRaster world_;
  GroundShape ground_;
  FrameRenderer renderer_;
  CameraSensor sensor_;
  ExposureControl exposure_;
};

}  // namespace nadir
