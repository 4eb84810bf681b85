// A request and its response without any transport: the server carries them, tests and fuzzers make them by hand.
// Requests that cannot be served are answered with application/problem+json (RFC 9457).
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <nlohmann/json_fwd.hpp>
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
  std::optional<std::uint64_t> content_length{};
  bool other_encoding = false;                   // Transfer-Encoding or Content-Encoding
  std::map<std::string, std::string> headers{};  // all of them; names in lower case, the first of several
  std::string body{};

  std::string_view path() const { return std::string_view(target).substr(0, target.find('?')); }
  const std::string* header(const std::string& lower_case_name) const {
    const auto found = headers.find(lower_case_name);
    return found == headers.end() ? nullptr : &found->second;
  }
};

struct ApiResponse {
  int status = 200;
  std::string content_type = "application/json";
  std::string body{};
  std::vector<std::pair<std::string, std::string>> headers{};
  // Set: the response goes on as server-sent events. Returns the text that is new since the last call, perhaps none.
  std::function<std::string()> stream{};
};

struct FieldError {
  std::string pointer;  // where in the body (RFC 6901): "/pixel/x"
  std::string detail;
};

// type: a word that programs can tell problems apart by; it appears as "urn:nadir:problem:TYPE".
struct Problem {
  int status = 400;
  std::string type;
  std::string detail;  // what is wrong and what to do about it
  std::vector<FieldError> errors{};
};

ApiResponse answer(const Problem& problem);

ApiResponse json_answer(int status, const nlohmann::json& document);

// What is different the next time.
ApiResponse without_cache(ApiResponse response);

// A part of a web page. It loads nothing from elsewhere, runs no script but its own, and cannot be framed.
ApiResponse page_answer(std::string_view text, std::string type);

// "Application/JSON; charset=utf-8" as "application/json".
std::string media_type(std::string_view content_type);

std::string lower_case(std::string_view text);  // ASCII

}  // namespace nadir
