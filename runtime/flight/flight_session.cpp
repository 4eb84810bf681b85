#include "flight/flight_session.hpp"

#include <fmt/format.h>

#include "cli/nadir_version.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {

SessionRecord flight_session(const Airframe& airframe, const FlightClock& clock) {
  const std::int64_t unix_us = clock.unix_us();
  SessionRecord session;
  session.program = "nadird";
  session.version = kVersion;
  session.airframe = airframe.id;
  session.started_ns = static_cast<std::uint64_t>(unix_us) * 1000;
  session.id = fmt::format("{}-{:x}", airframe.id, unix_us);
  session.camera = airframe.camera;
  session.picture_shrink = decode_reduction(airframe.camera.camera.width, airframe.camera.camera.height);
  session.looked_up_later = true;
  return session;
}

void add_start(SessionRecord& session, const LocalizingSetup& setup, const FlightGround& ground) {
  session.package = sha256_file(ground.folder() / kManifestFile);
  session.mission = ground.package().manifest().mission_id;
  session.origin = setup.frame.origin();
  session.start = setup.start;
  session.localizer = setup.config;
  session.terrain = setup.config.surface != nullptr;
  session.places = setup.config.places != nullptr;
  session.settings = {{"odometry", "features"}, {"matcher", "channels"}};  // LocalizerConfig's own
}

}  // namespace nadir
