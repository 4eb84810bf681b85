#include "base/utc_millis.hpp"

#include <fmt/format.h>

#include "base/time.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kMilli = 1000;

}  // namespace

std::string to_rfc3339(UtcMillis time) {
  const std::int64_t below = ((time.unix_ms % kMilli) + kMilli) % kMilli;
  std::string text = to_rfc3339(UtcTime{(time.unix_ms - below) / kMilli});
  text.pop_back();
  return fmt::format("{}.{:03}Z", text, below);
}

std::optional<UtcMillis> parse_utc_millis(std::string_view text) {
  constexpr std::size_t kLength = 24, kDot = 19;
  if (text.size() != kLength || text[kDot] != '.') return std::nullopt;
  std::int64_t below = 0;
  for (const char digit : text.substr(kDot + 1, 3)) {
    if (digit < '0' || digit > '9') return std::nullopt;
    below = below * 10 + (digit - '0');
  }
  const auto seconds = parse_utc(text);
  if (!seconds || seconds->unix_s < 0) return std::nullopt;
  const UtcMillis time{seconds->unix_s * kMilli + below};
  if (to_rfc3339(time) != text) return std::nullopt;  // "t" for "T" and the like
  return time;
}

}  // namespace nadir
