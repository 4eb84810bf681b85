// Who calls, as its headers say it. Pure text work: what follows from it is each service's own.
#pragma once

#include <optional>
#include <string_view>

#include "base/digest.hpp"

namespace nadir {

// Whether a Host header names this machine as itself ("LOCALHOST:8750", "[::1]:8750"). A page of somebody else's that
// a browser was led to by a name for 127.0.0.1 says another one.
bool names_loopback(std::string_view host);

// The digest of the token in "Bearer TOKEN"; nullopt for any other Authorization header. Digests are compared, so that
// the time it takes tells nothing about the token.
std::optional<Sha256> bearer_digest(std::string_view authorization);

}  // namespace nadir
