// The web page, embedded by cmake/EmbedText.cmake from page/.
#pragma once

#include <string_view>

namespace nadir::page {

extern const std::string_view html;
extern const std::string_view style;
extern const std::string_view dom;     // report/dom.js
extern const std::string_view script;  // after dom, and calls.js and base_map.js of map_page

}  // namespace nadir::page
