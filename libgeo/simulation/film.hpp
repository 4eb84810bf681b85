// The loop of a live camera: takes the newest pose when a frame is due, shoots, encodes, hands on. A frame that comes
// late is not made up for: the next one shows where the camera is then.
//
// Time is that of the poses, so that a simulator that runs ten times as fast as the clock gets its frames ten times as
// often; only patience is measured by the clock.
#pragma once

#include <chrono>
#include <functional>
#include <optional>

#include "simulation/frame_sink.hpp"
#include "simulation/live_camera.hpp"
#include "simulation/pose_source.hpp"

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
  std::optional<std::chrono::milliseconds> patience{};
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
CameraSimulationReport film(const LiveCamera& camera, PoseSource& poses, FrameSink& sink, const CameraSimulationOptions& options,
                const std::function<bool()>& stop);

}  // namespace nadir
