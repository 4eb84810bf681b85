// The desk's web page and its contract, embedded by cmake/EmbedText.cmake.
#pragma once

#include <string_view>

namespace nadir::desk_page {

extern const std::string_view html;
extern const std::string_view style;
extern const std::string_view dom;       // report/dom.js
extern const std::string_view script;    // after dom, and calls.js and map.js of map_page
extern const std::string_view contract;  // schemas/desk.openapi.json

}  // namespace nadir::desk_page
