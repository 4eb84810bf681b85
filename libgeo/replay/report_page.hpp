// The parts of the report's page, embedded from report/ by cmake/EmbedText.cmake.
#pragma once

#include <string_view>

namespace nadir::report_page {

extern const std::string_view html;  // with the places {{title}}, {{style}}, {{data}}, {{script}}
extern const std::string_view style;
extern const std::string_view dom;     // report/dom.js
extern const std::string_view script;  // after Leaflet, dom, and base_map.js of map_page

}  // namespace nadir::report_page
