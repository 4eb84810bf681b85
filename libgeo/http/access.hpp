// Where the API listens, and who may call: beyond loopback nobody without a token.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/sha256.hpp"

namespace nadir {

inline constexpr std::uint16_t kDefaultApiPort = 8750;

struct ListenAddress {
  std::string ip = "127.0.0.1";          // IPv4 or IPv6, as numbers
  std::uint16_t port = kDefaultApiPort;  // 0: any free one

  bool loopback() const;
};

// "127.0.0.1:8750", "[::1]:8750", "0.0.0.0:8750". Throws UsageError for anything else, names included: what a name
// means can change.
ListenAddress parse_listen_address(std::string_view text);

// Throws UsageError for an address beyond loopback without a token.
void require_token_beyond_loopback(const ListenAddress& address, const std::optional<Sha256>& token);

// Who calls, as its headers say it. Pure text work: what follows from it is each service's own.

// Whether a Host header names this machine as itself ("LOCALHOST:8750", "[::1]:8750"). A page of somebody else's that
// a browser was led to by a name for 127.0.0.1 says another one.
bool names_loopback(std::string_view host);

// The digest of the token in "Bearer TOKEN"; nullopt for any other Authorization header. Digests are compared, so that
// the time it takes tells nothing about the token.
std::optional<Sha256> bearer_digest(std::string_view authorization);

}  // namespace nadir
