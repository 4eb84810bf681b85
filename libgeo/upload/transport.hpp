// HTTP for the uploader: one request, one bounded reply, or why there was none. An interface, so that the
// uploader is tested without a network, and its implementation with libcurl.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "base/bytes.hpp"

namespace nadir {

struct HttpRequest {
  std::string method;
  std::string path;  // behind the service's address: "/v1/uploads"
  std::vector<std::pair<std::string, std::string>> headers{};
  ByteView body{};
};

struct HttpReply {
  int status = 0;
  std::map<std::string, std::string> headers{};  // names in lower case; the last of several
  std::string body{};

  const std::string* header(const std::string& name) const {
    const auto found = headers.find(name);
    return found == headers.end() ? nullptr : &found->second;
  }
};

// No answer: not reached, cut off, too slow, too much. Whether the service got the request is unknown.
struct NoReply {
  std::string why;
};

using HttpResult = std::variant<HttpReply, NoReply>;

class HttpTransport {
 public:
  virtual ~HttpTransport() = default;
  virtual HttpResult exchange(const HttpRequest& request) = 0;
};

// HTTP by libcurl: certificates and names verified, TLS 1.2 or newer, no redirects, every wait and every answer
// bounded. One connection, kept open between requests.

// Throws UsageError for anything but https://HOST[:PORT][/PATH], or http:// to this machine itself: a token never goes
// over a wire in the clear. Without a slash at the end.
std::string checked_service_address(std::string_view text);

struct CurlSettings {
  std::string address;  // checked
  std::string token;
  std::optional<std::filesystem::path> authorities;      // PEM file in the place of the system's
  std::uint64_t largest_reply = std::uint64_t{4} << 20;  // bytes; a longer answer is none
  int connect_timeout_s = 20;
  int stall_timeout_s = 60;  // so long without a byte per second, either way; and how far a transfer may fall behind:
  std::uint64_t slowest_bytes_s =
      512;  // body and reply, each from its beginning. A reply that is slower counts as none
  int request_timeout_s = 900;
};

struct CurlHandle;

class CurlTransport final : public HttpTransport {
 public:
  // check: called now and then during a request; what it throws ends the request and comes out of exchange().
  CurlTransport(CurlSettings settings, std::function<void()> check);
  ~CurlTransport() override;

  HttpResult exchange(const HttpRequest& request) override;

 private:
  CurlSettings settings_;
  std::function<void()> check_;
  std::unique_ptr<CurlHandle> handle_;
};

}  // namespace nadir
