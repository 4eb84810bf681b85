// Points in time as HTTP's headers say them (RFC 9110, section 5.6.7): "Sun, 06 Nov 1994 08:49:37 GMT", and the two old
// forms that a recipient must understand: "Sunday, 06-Nov-94 08:49:37 GMT" and "Sun Nov  6 08:49:37 1994".
#pragma once

#include <optional>
#include <string_view>

#include "base/time.hpp"

namespace nadir {

// nullopt for anything else. Years of two digits lie in 1970 to 2069. The name of the day is not checked.
std::optional<UtcTime> parse_http_date(std::string_view text);

}  // namespace nadir
