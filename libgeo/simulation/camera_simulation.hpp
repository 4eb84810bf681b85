// A simulated live camera over a synthetic or real world: takes the latest pose when a frame is due, renders, encodes,
// delivers. A frame that is late is not made up for: the next one shows where the camera is then.
//
// Frames are timed by the poses, so that a simulator that runs ten times as fast as the clock gets its frames ten times
// as often; only timeouts and the delay are measured by the clock.
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
#include "vision/camera.hpp"

namespace nadir {

// Where a simulated camera is, as an external source gives it: an autopilot's simulator over MAVLink, or a test's
// script.
struct LivePose {
  std::int64_t unix_us = 0;  // time of validity: UTC, microseconds since 1970
  LonLat place{};
  double height_m = 0;  // in the vertical datum of the elevation model
  Attitude attitude{};
  Eigen::Vector3d velocity_enu_mps = Eigen::Vector3d::Zero();
  Eigen::Vector3d rate_rad_s = Eigen::Vector3d::Zero();  // rolling, pitching, yawing: of the gyroscopes
};

class PoseSource {
 public:
  virtual ~PoseSource() = default;

  // The latest pose, if it was not returned before; older ones are dropped. Waits at most `timeout` for one.
  virtual std::optional<LivePose> latest(std::chrono::milliseconds timeout) = 0;
};

struct LiveCameraOptions {
  std::filesystem::path world;
  std::optional<std::filesystem::path> dem;  // none: flat ground at ground_m
  double ground_m = 0;
  std::filesystem::path camera;
  std::uint64_t seed = 1;
  SensorNoise noise = SensorNoise::real;
};

// Renders a frame for any pose over a world that is kept in memory, fast enough for real time. The local frame's origin
// is the world's centre, on the ground, so that a flight may go anywhere over it.
class LiveCamera {
 public:
  // Reads the world and the heights. Throws Error or UsageError for inputs that cannot be used.
  explicit LiveCamera(const LiveCameraOptions& options);

  // The same pose and frame number give the same image. A camera below the ground is lifted one metre above it; more
  // than twenty kilometres above or beside the world, and beyond its edges, everything is grey.
  RenderedFrame capture(const LivePose& pose, std::uint64_t number) const;

 private:
  LiveCamera(const LiveCameraOptions& options, const WorldExtent& extent);
  LiveCamera(const LiveCameraOptions& options, const WorldExtent& extent, const CameraFile& file);
  RenderedFrame render(const FlightPose& flight, const LivePose& pose) const;

  CameraModel camera_;
  std::optional<SensorReadout> readout_;
  SensorNoise noise_;
  PlaneBox box_;
  LocalFrame frame_;
  WorldRaster world_;
  GroundShape ground_;
  FrameRenderer renderer_;
  CameraSensor sensor_;
  ExposureControl exposure_;
};

struct CameraSimulationOptions {
  double fps = 5;
  std::optional<int> max_frames{};
  std::optional<double> seconds{};  // in the poses' time
  int quality = 92;                 // JPEG
  // From the arrival of a pose until its frame is delivered: the constant latency of a real camera. Further frames are
  // made meanwhile; frames that still wait when the simulation is stopped are dropped.
  std::chrono::milliseconds delay{0};
  // The simulation ends when no pose arrives for this long; none: it waits forever.
  std::optional<std::chrono::milliseconds> pose_timeout{};
};

enum class CameraSimulationEnd { all_frames, no_poses, stopped };

struct CameraSimulationReport {
  CameraSimulationEnd end = CameraSimulationEnd::stopped;
  int frames = 0;               // delivered
  int frames_beyond_world = 0;  // that show ground without map pixels somewhere
  int frames_missed = 0;        // due while another one was being made, or while no pose arrived
  int frames_late = 0;          // that took longer than the delay
  double seconds = 0;           // from the first to the last frame, in the poses' time
  double cpu_s = 0;             // of the process, for all frames
};

// stop: polled before every frame and several times a second.
CameraSimulationReport run_camera_simulation(const LiveCamera& camera, PoseSource& poses, FrameSink& sink,
                                             const CameraSimulationOptions& options, const std::function<bool()>& stop);

}  // namespace nadir
