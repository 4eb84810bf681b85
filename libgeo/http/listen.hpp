// Where the API listens, and who may call: beyond loopback nobody without a token.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/digest.hpp"

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

}  // namespace nadir
