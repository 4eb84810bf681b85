// The steps that make an autopilot fit to fly with us. Each stops with its reason, and what was changed is put back: an
// aircraft is provisioned or as it was before.
#pragma once

#include <functional>
#include <string_view>

#include "provision/autopilot_identity.hpp"
#include "provision/autopilot_parameters.hpp"
#include "provision/link_key.hpp"

namespace nadir {

struct ProvisioningWish {
  int receiver = 1;                      // that GPS_INPUT plays
  std::optional<SigningKey> key{};       // that the link is signed with afterwards
  std::filesystem::path signing_time{};  // of SigningTime, while it works; with a key
};

struct Provisioned {
  double imu_rate_hz = 0;
  bool restarted = false;
  bool key_installed = false;
};

// Restarts the autopilot and waits for it. Throws Error when it does not.
void restart(AutopilotSession& session, MavlinkAddress autopilot);

// Parameters, key, smoke test, then `last`: what must not happen unless all else succeeded. Throws the Error of the
// step that failed; its `fix` says when something could not be put back. told: a line for every step done.
Provisioned provision(AutopilotSession& session, const AutopilotIdentity& autopilot, LinkState link,
                      const std::vector<AutopilotParameter>& parameters, const ProvisioningWish& wish,
                      const std::function<void()>& last, const std::function<void(std::string_view)>& told);

}  // namespace nadir
