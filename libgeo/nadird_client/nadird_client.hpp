// Asks a running nadird over its API. Used by `nadir watch` and `nadird --status`.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

namespace nadir {

inline constexpr std::string_view kDefaultServiceUrl = "http://127.0.0.1:8750";

class NadirdClient {
 public:
  // url: "http://HOST[:PORT]". token: empty when none is wanted. Throws UsageError for another URL.
  explicit NadirdClient(std::string_view url, std::string token = {},
                        std::chrono::milliseconds patience = std::chrono::seconds(5));

  // The body of a GET. Throws Error when nobody answers in time, or answers with anything but 200.
  std::string get(const std::string& path) const;

  const std::string& url() const { return url_; }

 private:
  std::string url_;
  std::string host_;
  std::string port_;
  std::string token_;
  std::chrono::milliseconds patience_;
};

}  // namespace nadir
