// HTTP as the uploader needs it: one request, one bounded answer, or why there was none. Behind an interface, so that
// the uploader is tested without a network.
#pragma once

#include <cstdint>
#include <map>
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

}  // namespace nadir
