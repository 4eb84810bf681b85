// What the users of libcurl share: a handle, options that do not fail in silence, and header lines. Where only the
// ground reaches: this header alone names libcurl here, so that who includes it links it, and the library does not.
#pragma once

#include <curl/curl.h>
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <string>
#include <string_view>

#include "base/error.hpp"

namespace nadir {

struct CurlHandle {
  CurlHandle() {
    static std::once_flag once;
    std::call_once(once, [] { curl_global_init(CURL_GLOBAL_DEFAULT); });
    easy = curl_easy_init();
    if (easy == nullptr) throw Error({.what = "libcurl cannot be initialized", .fix = "check the memory that is left"});
  }
  ~CurlHandle() { curl_easy_cleanup(easy); }
  CurlHandle(const CurlHandle&) = delete;
  CurlHandle& operator=(const CurlHandle&) = delete;

  CURL* easy = nullptr;
};

template <typename Value>
void set_option(CURL* easy, CURLoption option, Value value) {
  if (const CURLcode code = curl_easy_setopt(easy, option, value); code != CURLE_OK) {
    throw Error({.what = "libcurl rejects a setting",
                 .where = fmt::format("option {}", static_cast<int>(option)),
                 .found = curl_easy_strerror(code),
                 .fix = "install libcurl 7.88 or later, with TLS"});
  }
}

// "Name: value" as CURLOPT_HEADERFUNCTION gets it; the name in lower case, and the last of several. Other lines are
// none.
inline void add_header_line(std::string_view line, std::map<std::string, std::string>& headers) {
  const std::size_t colon = line.find(':');
  if (colon == std::string_view::npos) return;
  std::string name(line.substr(0, colon));
  std::transform(name.begin(), name.end(), name.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  line.remove_prefix(colon + 1);
  while (!line.empty() && (line.front() == ' ' || line.front() == '\t')) line.remove_prefix(1);
  while (!line.empty() && (line.back() == '\r' || line.back() == '\n' || line.back() == ' ')) line.remove_suffix(1);
  headers[name] = line;
}

}  // namespace nadir
