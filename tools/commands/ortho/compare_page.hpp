// The page that compares a flight's tiles with the map: one file with its images inside, no network needed.
#pragma once

#include <string>
#include <string_view>

#include "cli/output.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

namespace compare_page_text {  // embedded by cmake/EmbedText.cmake
extern const std::string_view html;
extern const std::string_view style;
extern const std::string_view script;
}  // namespace compare_page_text

struct ComparePage {
  std::string title, subtitle;
  Figures headline;  // value, name
  Figures figures;   // name, value
};

// Both tile sets over the box in the plane of `frame`. Throws Error when one of them cannot be read.
std::string compare_page(const ComparePage& page, const TileSource& map, const TileSource& flight,
                         const LocalFrame& frame, const PlaneBox& box);

}  // namespace nadir
