#include "package/package_path.hpp"

#include <algorithm>

namespace nadir {
namespace {

bool allowed(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-';
}

}  // namespace

std::optional<std::string> path_problem(std::string_view path) {
  if (path.empty()) return "an empty name";
  if (path.size() > kMaxPackagePath) return "a name of more than " + std::to_string(kMaxPackagePath) + " characters";
  if (path.front() == '/') return "an absolute path";
  std::size_t begin = 0;
  while (begin <= path.size()) {
    const std::size_t end = std::min(path.find('/', begin), path.size());
    const std::string_view part = path.substr(begin, end - begin);
    if (part.empty()) return "an empty part between slashes";
    if (part == "..") return "\"..\", which leads out of the package";
    if (part.front() == '.') return "a part that begins with a dot";
    for (const char c : part) {
      if (!allowed(c)) return "a character other than letters, digits, '.', '_' and '-'";
    }
    begin = end + 1;
  }
  return std::nullopt;
}

std::string case_fold(std::string_view path) {
  std::string folded(path);
  for (char& c : folded) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return folded;
}

}  // namespace nadir
