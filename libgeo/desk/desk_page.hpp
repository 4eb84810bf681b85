// The web pages of the desk's two rooms and its contract, embedded by cmake/EmbedText.cmake.
#pragma once

#include <string_view>

namespace nadir::desk_page {

extern const std::string_view html;
extern const std::string_view style;
extern const std::string_view dom;     // report/dom.js
extern const std::string_view script;  // after dom, and calls.js and map.js of map_page
extern const std::string_view missions_html;
extern const std::string_view missions_style;   // after style
extern const std::string_view missions_script;  // after dom, and calls.js and base_map.js of map_page
extern const std::string_view contract;         // schemas/desk.openapi.json

}  // namespace nadir::desk_page
