#include "base/time.hpp"

#include <fmt/format.h>

#include <charconv>
#include <chrono>

namespace nadir {
namespace {

constexpr std::int64_t kMilli = 1000;

// Takes exactly `digits` digits from the front of `text`.
std::optional<int> take_number(std::string_view& text, std::size_t digits) {
  if (text.size() < digits) return std::nullopt;
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + digits, value);
  if (error != std::errc{} || end != text.data() + digits || text.front() == '-') return std::nullopt;
  text.remove_prefix(digits);
  return value;
}

bool take_char(std::string_view& text, std::string_view any_of) {
  if (text.empty() || any_of.find(text.front()) == std::string_view::npos) return false;
  text.remove_prefix(1);
  return true;
}

std::optional<std::int64_t> take_date_s(std::string_view& text) {
  using namespace std::chrono;
  const auto y = take_number(text, 4);
  if (!y || !take_char(text, "-")) return std::nullopt;
  const auto m = take_number(text, 2);
  if (!m || !take_char(text, "-")) return std::nullopt;
  const auto d = take_number(text, 2);
  if (!d) return std::nullopt;
  const year_month_day date{year{*y}, month{static_cast<unsigned>(*m)}, day{static_cast<unsigned>(*d)}};
  if (!date.ok()) return std::nullopt;
  return std::int64_t{sys_days{date}.time_since_epoch().count()} * 86400;
}

std::optional<int> take_clock_s(std::string_view& text) {
  const auto h = take_number(text, 2);
  if (!h || !take_char(text, ":")) return std::nullopt;
  const auto m = take_number(text, 2);
  if (!m || !take_char(text, ":")) return std::nullopt;
  const auto s = take_number(text, 2);
  if (!s || *h > 23 || *m > 59 || *s > 59) return std::nullopt;
  if (take_char(text, ".")) {
    if (!take_number(text, 1)) return std::nullopt;
    while (take_char(text, "0123456789")) {
    }
  }
  return *h * 3600 + *m * 60 + *s;
}

std::optional<int> take_offset_s(std::string_view& text) {
  if (take_char(text, "Zz")) return 0;
  if (text.empty()) return std::nullopt;
  const int sign = text.front() == '-' ? -1 : 1;
  if (!take_char(text, "+-")) return std::nullopt;
  const auto h = take_number(text, 2);
  if (!h || !take_char(text, ":")) return std::nullopt;
  const auto m = take_number(text, 2);
  if (!m || *h > 23 || *m > 59) return std::nullopt;
  return sign * (*h * 3600 + *m * 60);
}

}  // namespace

std::optional<UtcTime> parse_utc(std::string_view text) {
  const auto date_s = take_date_s(text);
  if (!date_s) return std::nullopt;
  if (text.empty()) return UtcTime{*date_s};
  if (!take_char(text, "Tt ")) return std::nullopt;
  const auto clock_s = take_clock_s(text);
  if (!clock_s) return std::nullopt;
  const auto offset_s = take_offset_s(text);
  if (!offset_s || !text.empty()) return std::nullopt;
  return UtcTime{*date_s + *clock_s - *offset_s};
}

std::string to_rfc3339(UtcTime time) {
  using namespace std::chrono;
  const sys_seconds point{seconds{time.unix_s}};
  const auto day_start = floor<days>(point);
  const year_month_day date{day_start};
  const hh_mm_ss clock{point - day_start};
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z", static_cast<int>(date.year()),
                     static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()), clock.hours().count(),
                     clock.minutes().count(), clock.seconds().count());
}

UtcTime SystemClock::now() const {
  using namespace std::chrono;
  return UtcTime{duration_cast<seconds>(system_clock::now().time_since_epoch()).count()};
}

std::string to_rfc3339(UtcMillis time) {
  const std::int64_t millis = ((time.unix_ms % kMilli) + kMilli) % kMilli;
  std::string text = to_rfc3339(UtcTime{(time.unix_ms - millis) / kMilli});
  text.pop_back();
  return fmt::format("{}.{:03}Z", text, millis);
}

std::optional<UtcMillis> parse_utc_millis(std::string_view text) {
  constexpr std::size_t kLength = 24, kDot = 19;
  if (text.size() != kLength || text[kDot] != '.') return std::nullopt;
  std::int64_t millis = 0;
  for (const char digit : text.substr(kDot + 1, 3)) {
    if (digit < '0' || digit > '9') return std::nullopt;
    millis = millis * 10 + (digit - '0');
  }
  const auto seconds = parse_utc(text);
  if (!seconds || seconds->unix_s < 0) return std::nullopt;
  const UtcMillis time{seconds->unix_s * kMilli + millis};
  if (to_rfc3339(time) != text) return std::nullopt;  // "t" for "T" and the like
  return time;
}

}  // namespace nadir
