// A request and its answer, without any transport: the server carries them, the tests and the fuzzer make them by hand.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace nadir {

struct ApiRequest {
  std::string method{};  // "GET"
  std::string target{};  // "/v1/state?x=y"
  std::string host{};    // the Host header
  std::string authorization{};
  std::string content_type{};
  std::string last_event_id{};
  std::string body{};
};

struct ApiResponse {
  int status = 200;
  std::string content_type = "application/json";
  std::string body{};
  std::vector<std::pair<std::string, std::string>> headers{};
  bool stream = false;  // the body goes on as server-sent events (event_stream.hpp)
};

}  // namespace nadir
