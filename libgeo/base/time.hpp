// Points in time (UTC, to the second and to the millisecond) and clocks. Time is always passed in, so that every
// program can be run as of another time (--at) and tests control the clock.
#pragma once

#include <compare>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace nadir {

struct UtcTime {
  std::int64_t unix_s = 0;  // seconds since 1970-01-01T00:00:00Z, leap seconds not counted

  auto operator<=>(const UtcTime&) const = default;
};

// Reads RFC 3339 ("2024-10-30T00:00:00Z", offsets and fractions of a second allowed, the latter dropped) or a plain
// date ("2024-10-30", midnight UTC). Anything else, impossible dates included, is nullopt.
std::optional<UtcTime> parse_utc(std::string_view text);

// "2024-10-30T00:00:00Z"
std::string to_rfc3339(UtcTime time);

// To the millisecond, for what is signed: one spelling only, "2026-05-01T12:00:00.250Z".
struct UtcMillis {
  std::int64_t unix_ms = 0;  // since 1970-01-01T00:00:00Z, leap seconds not counted

  auto operator<=>(const UtcMillis&) const = default;
};

std::string to_rfc3339(UtcMillis time);

// Exactly the form above, years 1970 to 9999; everything else is nullopt.
std::optional<UtcMillis> parse_utc_millis(std::string_view text);

class Clock {
 public:
  virtual ~Clock() = default;
  virtual UtcTime now() const = 0;
};

class SystemClock final : public Clock {
 public:
  UtcTime now() const override;
};

class FixedClock final : public Clock {
 public:
  explicit FixedClock(UtcTime time) : time_(time) {}
  UtcTime now() const override { return time_; }

 private:
  UtcTime time_;
};

}  // namespace nadir
