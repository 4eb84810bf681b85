// One simulated flight segment: the true poses, what the sensors measured, what the camera saw.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "estimation/localizer.hpp"
#include "estimation/telemetry.hpp"
#include "safety_camera.hpp"
#include "safety_conditions.hpp"

namespace nadir::bench {

struct Shot {
  CameraPose truth;
  Telemetry telemetry;
  cv::Mat picture;       // BGR; empty: could not be decoded
  bool shifted = false;  // part of the map beneath it is shifted
};

struct Flight {
  const Condition* condition = nullptr;
  std::uint64_t seed = 0;
  std::size_t world = 0;
  std::vector<Shot> shots;
  std::optional<LonLat> start;
  double start_sigma_m = 0;
  PlaneBox area;                 // that contains the start, for runs without one
  PlanePoint shift;              // of the map, where there is one
  std::optional<Border> border;  // beyond which the map is shifted; none: everywhere
};

enum class FrameSpacing {
  usual,   // 20 to 75 m
  sparse,  // 60 to 100 % of the footprint: frames that hardly overlap, or not at all
};
std::string spacing_name(FrameSpacing spacing);  // ", sparse", for headers

Flight make_flight(std::uint64_t seed, const std::vector<std::unique_ptr<World>>& worlds,
                   const Photographer& photographer, FrameSpacing spacing = FrameSpacing::usual);

// A localizer's start on it.
LocalizerConfig config_of(const Flight& flight, const World& world);

}  // namespace nadir::bench
