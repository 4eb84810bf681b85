// What nadird is started with.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "geodesy/lon_lat.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct FlightOptions {
  std::filesystem::path package;
  Airframe airframe;
  std::filesystem::path state;                      // folder
  std::string camera;                               // open_camera()
  std::string autopilot;                            // parse_endpoint()
  std::optional<std::filesystem::path> link_key;    // none: the link is not signed
  std::optional<std::filesystem::path> record;      // folder; none: nothing is recorded
  bool keep_pictures = false;                       // in the recording
  std::optional<std::filesystem::path> candidates;  // folder for candidate tiles; none: none are made
  std::optional<std::filesystem::path> tile_key;    // what they are signed with; alone: nobody would accept them
  std::int64_t candidates_mb = 2000;                // most that they may take
  int candidates_percent = 25;                      // of one core, to make them
  int candidates_frame_ms = 0;                      // most for one frame; 0: no such limit
  std::string listen = "127.0.0.1:8750";
  std::optional<std::filesystem::path> token;  // file with the API's bearer token
  std::optional<LonLat> start;
  double anchor_every_m = 0;
  bool send_external_position = false;  // MAV_CMD_EXTERNAL_POSITION_ESTIMATE for each anchor, besides GPS_INPUT
};

}  // namespace nadir
