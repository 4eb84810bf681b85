#include "http/access.hpp"

#include <arpa/inet.h>

#include "base/error.hpp"
#include "base/number_text.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

std::optional<std::string> ip_of(std::string_view host) {
  unsigned char bytes[16];
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') {
    std::string inner(host.substr(1, host.size() - 2));
    return inet_pton(AF_INET6, inner.c_str(), bytes) == 1 ? std::optional(inner) : std::nullopt;
  }
  std::string plain(host);
  return inet_pton(AF_INET, plain.c_str(), bytes) == 1 ? std::optional(plain) : std::nullopt;
}

bool is_port(std::string_view digits) { return whole_number<std::uint16_t>(digits).has_value(); }

}  // namespace

bool ListenAddress::loopback() const { return ip == "::1" || ip.starts_with("127."); }

ListenAddress parse_listen_address(std::string_view text) {
  const std::size_t colon = text.rfind(':');
  if (colon != std::string_view::npos) {
    const std::optional<std::string> ip = ip_of(text.substr(0, colon));
    const std::optional<std::uint16_t> port = whole_number<std::uint16_t>(text.substr(colon + 1));
    if (ip && port) return {.ip = *ip, .port = *port};
  }
  throw UsageError({.what = "not an address to listen on",
                    .expected = "IP:PORT, as in 127.0.0.1:8750 or [::1]:8750",
                    .found = printable(text)});
}

void require_token_beyond_loopback(const ListenAddress& address, const std::optional<Sha256>& token) {
  if (address.loopback() || token) return;
  throw UsageError({.what = "listening beyond loopback requires a token",
                    .expected = "a token file, or a loopback address",
                    .found = address.ip,
                    .fix = "give a token file, or listen on 127.0.0.1 and reach it through ssh -L"});
}

bool names_loopback(std::string_view host) {
  for (const std::string_view name : {"localhost", "127.0.0.1", "[::1]"}) {
    if (lower_case(host.substr(0, name.size())) != name) continue;
    const std::string_view rest = host.substr(name.size());
    return rest.empty() || (rest.starts_with(':') && is_port(rest.substr(1)));
  }
  return false;
}

std::optional<Problem> access_problem(const ApiRequest& request, bool loopback, const std::optional<Sha256>& token) {
  if (loopback && !names_loopback(request.host)) {
    return Problem{.status = 421, .type = "host", .detail = "this service is called by localhost, 127.0.0.1 or [::1]"};
  }
  if (!token || !request.path().starts_with("/v1/")) return std::nullopt;
  if (bearer_digest(request.authorization) == token) return std::nullopt;
  return Problem{.status = 401, .type = "token", .detail = "send Authorization: Bearer TOKEN"};
}

std::optional<Sha256> bearer_digest(std::string_view authorization) {
  constexpr std::string_view kScheme = "bearer ";
  if (lower_case(authorization.substr(0, kScheme.size())) != kScheme) return std::nullopt;
  return sha256(as_bytes(authorization.substr(kScheme.size())));
}

}  // namespace nadir
