// Manual pages in man(7)'s macros, from what --help says.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace nadir {

struct ProgramModel;

// Each page with its file's name: nadir.1, nadir-cache-build.1, …, or nadird.8 alone. The same program gives the same
// bytes: no page has a date.
std::vector<std::pair<std::string, std::string>> manual_pages(const ProgramModel& program);

// `text` so that roff prints it as it is: escaped, in ASCII. Lines that begin with a full stop or an apostrophe are no
// requests.
std::string roff_text(std::string_view text);

}  // namespace nadir
