// The parts of the report's page, embedded from this folder by cmake/EmbedText.cmake.
#pragma once

#include <string_view>

namespace nadir::cache_report_page {

extern const std::string_view html;  // with the places {{title}}, {{style}}, {{data}}, {{script}}
extern const std::string_view style;
extern const std::string_view script;

}  // namespace nadir::cache_report_page
