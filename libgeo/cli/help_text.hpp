// How help texts are set, on a terminal and in manual pages: paragraphs are separated by empty lines and filled; a
// paragraph with a table or a list, which is laid out by hand, stays as it is.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace nadir {

// The parts between separators, without an empty one at the end.
std::vector<std::string_view> split_text(std::string_view text, std::string_view separator);

// A line of it begins with blanks, or has columns.
bool laid_out(std::string_view paragraph);

// In lines of at most 100 columns, the indent included. Every line but the first starts with `indent` blanks.
std::string filled(std::string_view text, std::size_t indent);

}  // namespace nadir
