// Numbers of things in messages.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace nadir {

// "1 sector", "2 sectors". `plural` where it is not the noun with an s.
std::string count(std::uint64_t number, std::string_view noun, std::string_view plural = {});

}  // namespace nadir
