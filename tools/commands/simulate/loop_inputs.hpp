// What a closed loop needs before it flies: a landscape, its signed map package, an airframe. Made by nadir's own
// commands, as a user would.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "cli/command.hpp"
#include "package/mission.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct LoopInputs {
  std::filesystem::path world;  // folder
  std::filesystem::path package, trust, airframe;
  Mission mission;
  double altitude_m = 0;  // above the sea
  std::vector<LonLat> circuit;
};

inline constexpr double kLoopCaptureDelay_s = 0.25;

// nadir: this program. world: of `nadir simulate world`; nullopt: one is made. parameters: of the autopilot, as the
// airframe file lists them. All else is made in `folder`. Throws Interrupted on Ctrl-C.
LoopInputs make_loop_inputs(const std::filesystem::path& nadir, const std::optional<std::filesystem::path>& world,
                            const std::vector<AirframeParameter>& parameters, const std::filesystem::path& folder,
                            Context& context);

}  // namespace nadir
