// How the values of a raster that is not 8 bit (16 bit, float) become 8 bit colours: one linear function for all its
// bands, low to 0 and high to 255, clipped beyond. Values are those of the file, before its scale and offset.
//
//   colour = 255 (value - low) / (high - low)
#pragma once

#include <filesystem>
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
struct StretchRequest {
  enum class Kind { none, values, percentile };  // none: for a raster that is 8 bit already
  Kind kind = Kind::none;
  double low = 0;
  double high = 0;
};

// "MIN,MAX", "percentile:LOW,HIGH" or "none". Throws UsageError for anything else.
StretchRequest parse_stretch(std::string_view text);

std::string to_text(const Stretch& stretch);  // "112 to 9873", shortest numbers that parse back to the same values

// The stretch for this raster; none for a raster that is 8 bit, which keeps its values. Percentiles are of the valid
// pixels of all colour bands together, with linear interpolation (percentile 0 is the minimum, 100 the maximum). They
// come from a deterministic sample: all pixels of a small raster, else small windows spread evenly over it. Throws
// UsageError, with the range of values, for a raster that needs a stretch and has none.
std::optional<Stretch> resolve_stretch(const std::filesystem::path& raster, const StretchRequest& request);

}  // namespace nadir
