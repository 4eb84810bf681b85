// Names of files inside a package. They come from a signed document, but are checked all the same: a name must mean the
// same file on every file system and can never lead out of the package.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace nadir {

inline constexpr std::size_t kMaxPackagePath = 200;

// What is wrong with the name; nullopt when nothing is. Good: relative, parts of letters, digits, '.', '_' and '-'
// joined by single '/', no part beginning with '.', at most 200 characters.
std::optional<std::string> path_problem(std::string_view path);

// Two names that a file system without upper and lower case takes for one have the same fold.
std::string case_fold(std::string_view path);

}  // namespace nadir
