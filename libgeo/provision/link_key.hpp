// The key that an autopilot signs its link with: brought there over an unsigned link, and proved by what it signs.
#pragma once

#include <filesystem>

#include "provision/autopilot_session.hpp"

namespace nadir {

enum class LinkState { unsigned_link, signed_with_key };

// Opens the session as the autopilot speaks. Throws Error when nobody speaks, or it signs with another key.
LinkState open_as_it_speaks(AutopilotSession& session, const std::optional<SigningKey>& key,
                            const std::filesystem::path& time_file);

// Sends the key and opens the session signed. Throws Error when what comes back is not signed with it.
void install_key(AutopilotSession& session, MavlinkAddress autopilot, const SigningKey& key,
                 const std::filesystem::path& time_file);

// Over the signed session. False: nothing unsigned was heard afterwards.
bool remove_key(AutopilotSession& session, MavlinkAddress autopilot);

}  // namespace nadir
