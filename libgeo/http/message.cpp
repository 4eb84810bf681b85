#include "http/message.hpp"

#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/printable.hpp"

namespace nadir {
namespace {

const char* title_of(int status) {
  switch (status) {
    case 400: return "Bad request";
    case 401: return "Token required";
    case 403: return "Not allowed";
    case 404: return "Not found";
    case 405: return "Method not allowed";
    case 409: return "Not possible in this state";
    case 411: return "Length required";
    case 413: return "Body too large";
    case 415: return "Wrong media type";
    case 421: return "Wrong host";
    case 422: return "Refused";
    case 429: return "Too many requests";
    case 431: return "Header too large";
    case 460: return "Checksum mismatch";
    case 503: return "Not available";
    case 507: return "Storage full";
    default: return "Failed";
  }
}

}  // namespace

ApiResponse answer(const Problem& problem) {
  nlohmann::json document{{"type", "urn:nadir:problem:" + problem.type},
                          {"title", title_of(problem.status)},
                          {"status", problem.status},
                          {"detail", printable(problem.detail)}};
  for (const FieldError& error : problem.errors) {
    document["errors"].push_back({{"pointer", printable(error.pointer)}, {"detail", printable(error.detail)}});
  }
  return {.status = problem.status, .content_type = "application/problem+json", .body = document.dump()};
}

ApiResponse json_answer(int status, const nlohmann::json& document) {
  return {.status = status, .body = document.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
}

ApiResponse without_cache(ApiResponse response) {
  response.headers.emplace_back("Cache-Control", "no-store");
  return response;
}

ApiResponse page_answer(std::string_view text, std::string type) {
  return {.content_type = std::move(type),
          .body = std::string(text),
          .headers = {{"Content-Security-Policy",
                       "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
                       "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"},
                      {"Cache-Control", "no-cache"}}};
}

std::string lower_case(std::string_view text) {
  std::string lower(text);
  std::transform(lower.begin(), lower.end(), lower.begin(), [](unsigned char c) { return std::tolower(c); });
  return lower;
}

std::string media_type(std::string_view content_type) {
  content_type = content_type.substr(0, content_type.find(';'));
  while (content_type.ends_with(' ') || content_type.ends_with('\t')) content_type.remove_suffix(1);
  return lower_case(content_type);
}

}  // namespace nadir
