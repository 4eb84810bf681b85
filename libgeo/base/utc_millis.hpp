// Points in time to the millisecond, for what is signed: one spelling only, "2026-05-01T12:00:00.250Z".
#pragma once

#include <compare>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace nadir {

struct UtcMillis {
  std::int64_t unix_ms = 0;  // since 1970-01-01T00:00:00Z, leap seconds not counted

  auto operator<=>(const UtcMillis&) const = default;
};

std::string to_rfc3339(UtcMillis time);

// Exactly the form above, years 1970 to 9999; everything else is nullopt.
std::optional<UtcMillis> parse_utc_millis(std::string_view text);

}  // namespace nadir
