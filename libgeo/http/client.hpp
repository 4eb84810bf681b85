// One HTTP/1.1 GET on a connection of its own, all of it within one time limit, the answer bounded.
#pragma once

#include <chrono>
#include <string>
#include <variant>

namespace nadir {

struct HttpGet {
  std::string host;  // as in a URL: an IPv6 address in brackets
  std::string port;
  std::string path;
  std::string bearer_token{};  // empty: none is sent
};

struct HttpAnswer {
  int status = 0;
  std::string body;
};

// Why there is no answer: not reached, cut off, too slow, too large.
struct NoHttpAnswer {
  std::string reason;
};

std::variant<HttpAnswer, NoHttpAnswer> http_get(const HttpGet& get, std::chrono::milliseconds timeout);

}  // namespace nadir
