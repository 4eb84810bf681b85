#include "http/access.hpp"

#include <algorithm>
#include <cctype>
#include <string>

namespace nadir {
namespace {

std::string lower_case(std::string_view text) {
  std::string lower(text);
  std::transform(lower.begin(), lower.end(), lower.begin(), [](unsigned char c) { return std::tolower(c); });
  return lower;
}

}  // namespace

bool names_loopback(std::string_view host) {
  const std::string name = lower_case(host.substr(0, host.starts_with('[') ? host.find(']') + 1 : host.find(':')));
  return name == "localhost" || name == "127.0.0.1" || name == "[::1]";
}

std::optional<Sha256> bearer_digest(std::string_view authorization) {
  constexpr std::string_view kScheme = "bearer ";
  if (lower_case(authorization.substr(0, kScheme.size())) != kScheme) return std::nullopt;
  return sha256(as_bytes(authorization.substr(kScheme.size())));
}

}  // namespace nadir
