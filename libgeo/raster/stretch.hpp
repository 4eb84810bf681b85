// How the values of a raster that is not 8 bit (16 bit, float) become 8 bit colours: one straight line for all its
// bands, low to 0 and high to 255, what lies beyond cut off. Values are those of the file, before its scale and offset.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace nadir {

struct Stretch {
  double low = 0;
  double high = 0;  // above low

  bool operator==(const Stretch&) const = default;
};

// What the user asks for: the two values themselves, or percentiles of the valid pixels.
struct StretchWish {
  enum class Kind { none, values, percentile };  // none: for a raster that is 8 bit already
  Kind kind = Kind::none;
  double low = 0;
  double high = 0;
};

// "MIN,MAX", "percentile:LOW,HIGH" or "none". Throws UsageError for anything else.
StretchWish parse_stretch(std::string_view text);

std::string to_text(const Stretch& stretch);  // "112 to 9873", shortest numbers that read back the same

}  // namespace nadir
