// The loop of a live camera: takes the newest pose when a frame is due, shoots, encodes, hands on. A frame that comes
// late is not made up for: the next one shows where the camera is then.
//
// Time is that of the poses, so that a simulator that runs ten times as fast as the clock gets its frames ten times as
// often; only patience is measured by the clock.
#pragma once

#include <Eigen/Core>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>

#include "geodesy/lon_lat.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/frame_renderer.hpp"
#include "simulation/frame_sink.hpp"
#include "simulation/world_raster.hpp"
#include "vision/camera_model.hpp"

namespace nadir {

struct CameraSimulationOptions {
  double fps = 5;
  std::optional<int> max_frames{};
  std::optional<double> seconds{};  // of the poses' time
  int quality = 92;                 // JPEG
  // From a pose's arrival until its picture is handed on: as a real camera takes, the same for each. Others are made
  // meanwhile; what waits when it is stopped is dropped.
  std::chrono::milliseconds delay{0};
  // No pose for so long ends the film; none: it waits for ever.
  std::optional<std::chrono::milliseconds> pose_timeout{};
};

enum class CameraSimulationEnd { all_frames, no_poses, stopped };

struct CameraSimulationReport {
  CameraSimulationEnd end = CameraSimulationEnd::stopped;
  int frames = 0;               // handed on
  int frames_beyond_world = 0;  // that show ground without map pixels somewhere
  int frames_missed = 0;        // due while another was being made, or while no pose came
  int frames_late = 0;          // that took longer than the delay
  double seconds = 0;           // from the first to the last frame, in the poses' time
  double cpu_s = 0;             // of the process, for all frames
};

// stop: asked before every frame and several times a second.
CameraSimulationReport run_camera_simulation(const LiveCamera& camera, PoseSource& poses, FrameSink& sink, const CameraSimulationOptions& options,
                const std::function<bool()>& stop);

// A camera over a world that is kept in memory: a picture for any pose, fast enough for real time. film.hpp runs it.
//
// The local frame's origin is the world's centre, on the ground, so that a flight may go anywhere over it.

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
  RenderedFrame capture(const LivePose& pose, std::uint64_t number) const;

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

// Where a simulated camera is, as somebody outside tells it: an autopilot's simulator over MAVLink, or a test's script.

struct LivePose {
  std::int64_t unix_us = 0;  // when it was there: UTC, microseconds since 1970
  LonLat place{};
  double height_m = 0;  // as the elevation model counts heights
  Attitude attitude{};
  Eigen::Vector3d velocity_enu_mps = Eigen::Vector3d::Zero();
};

class PoseSource {
 public:
  virtual ~PoseSource() = default;

  // The newest pose, if it was not given before; older ones are dropped. Waits at most so long for one to come.
  virtual std::optional<LivePose> latest(std::chrono::milliseconds pose_timeout) = 0;
};

}  // namespace nadir
