// Camera and autopilot before take-off, as `nadird --check` looks at them: whether frames of the camera's size arrive,
// and whether the configured autopilot is on the link, signed as configured.
#pragma once

#include <optional>
#include <string>

#include "base/error.hpp"
#include "camera/camera_source.hpp"
#include "flight/video_stream_finder.hpp"
#include "mavlink/signing.hpp"
#include "mavlink/transport.hpp"
#include "service/clock.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct PartCheck {
  std::string found{};  // for people: "frame 0001.jpg, 1280 x 720, after 0.3 s"
  Findings findings{};  // why the part is not ready
};

// Waits at most limit_s for a frame. camera: as the airframe file describes it; nullopt: any size is right.
// Findings: camera.no_frame, camera.size.
PartCheck check_camera(CameraSource& source, const std::optional<CameraModel>& camera, const FlightClock& clock,
                       double limit_s);

// Asks a MAVLink camera for its video stream, at most for limit_s. Findings: camera.no_stream.
PartCheck find_stream(std::unique_ptr<Transport> transport, const Airframe& airframe, std::optional<Signing> signing,
                      VideoStreamFinder& finder, const FlightClock& clock, double limit_s);

// Waits at most limit_s for a heartbeat of the airframe's autopilot; sends a heartbeat each second, because a peer of
// udpout does not know our address before. signing: nullopt: the link is not signed. Findings: autopilot.silent.
PartCheck check_autopilot(std::unique_ptr<Transport> transport, const Airframe& airframe,
                          std::optional<Signing> signing, const FlightClock& clock, double limit_s);

}  // namespace nadir
