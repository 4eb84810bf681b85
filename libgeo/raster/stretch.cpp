#include "raster/stretch.hpp"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

#include "base/error.hpp"

namespace nadir {
namespace {

std::optional<double> number_from(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

}  // namespace

StretchWish parse_stretch(std::string_view text) {
  if (text == "none") return {};
  constexpr std::string_view kPercentile = "percentile:";
  StretchWish wish{.kind = StretchWish::Kind::values};
  std::string_view numbers = text;
  if (numbers.starts_with(kPercentile)) {
    wish.kind = StretchWish::Kind::percentile;
    numbers.remove_prefix(kPercentile.size());
  }
  const std::size_t comma = numbers.find(',');
  if (comma != std::string_view::npos) {
    const auto low = number_from(numbers.substr(0, comma)), high = number_from(numbers.substr(comma + 1));
    if (low && high && *low < *high) {
      wish.low = *low, wish.high = *high;
      if (wish.kind == StretchWish::Kind::values || (wish.low >= 0 && wish.high <= 100)) return wish;
    }
  }
  throw UsageError({.what = "the stretch does not read",
                    .where = "--stretch",
                    .expected = "MIN,MAX with MIN below MAX; percentile:LOW,HIGH between 0 and 100; or none",
                    .found = std::string(text),
                    .fix = "for example --stretch 0,4000 or --stretch percentile:2,98"});
}

std::string to_text(const Stretch& stretch) { return fmt::format("{} to {}", stretch.low, stretch.high); }

}  // namespace nadir
