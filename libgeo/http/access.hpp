// Where a service listens and who may call it: beyond loopback only with a token. Pure text work; what follows from it
// is up to each service.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/digest.hpp"
#include "http/message.hpp"

namespace nadir {

inline constexpr std::uint16_t kDefaultApiPort = 8750;

struct ListenAddress {
  std::string ip = "127.0.0.1";          // IPv4 or IPv6, as numbers
  std::uint16_t port = kDefaultApiPort;  // 0: any free one

  bool loopback() const;
};

// "127.0.0.1:8750", "[::1]:8750", "0.0.0.0:8750". Throws UsageError for anything else, host names included:
// what they resolve to can change.
ListenAddress parse_listen_address(std::string_view text);

// Throws UsageError for an address beyond loopback without a token.
void require_token_beyond_loopback(const ListenAddress& address, const std::optional<Sha256>& token);

// Whether a Host header is exactly a name of this machine for itself, with or without a port ("LOCALHOST:8750",
// "[::1]:8750"). A page of another site that reaches 127.0.0.1 under a name of its own (DNS rebinding) sends that name.
bool names_loopback(std::string_view host);

// Why this request may not be answered; nullopt: it may. loopback: the service listens there alone, and the Host must
// be a name of it. token: the digest of what every path under /v1/ needs; without one they are open. A page itself
// holds no secret, and asks for the token.
std::optional<Problem> access_problem(const ApiRequest& request, bool loopback, const std::optional<Sha256>& token);

// The digest of the token in "Bearer TOKEN"; nullopt for any other Authorization header. Comparing
// digests instead of tokens leaks nothing through timing.
std::optional<Sha256> bearer_digest(std::string_view authorization);

}  // namespace nadir
