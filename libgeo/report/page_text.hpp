// What report pages are put together with: a page with places {{name}}, and data that cannot break out of it.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace nadir {

// As JSON for a <script> element. Names come from outside: nothing in the data may end the element or open a tag.
std::string script_safe(const nlohmann::json& data);

std::string html_escaped(std::string_view text);

// Fills the places of the page in one pass, so that what is filled in is not searched for places again.
std::string fill_page(std::string_view page, const std::vector<std::pair<std::string_view, std::string_view>>& values);

}  // namespace nadir
