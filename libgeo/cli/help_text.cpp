#include "cli/help_text.hpp"

#include <algorithm>

namespace nadir {
namespace {

constexpr std::size_t kColumns = 100;

// Columns of UTF-8 text in letters that are one column wide.
std::size_t columns_of(std::string_view text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; }));
}

std::string filled_paragraph(std::string_view text, std::size_t indent) {
  const std::string line_end = "\n" + std::string(indent, ' ');
  std::string result;
  std::size_t column = indent;
  for (std::size_t at = text.find_first_not_of(" \n"); at < text.size(); at = text.find_first_not_of(" \n", at)) {
    const std::string_view word = text.substr(at, std::min(text.find_first_of(" \n", at), text.size()) - at);
    const std::size_t width = columns_of(word);
    if (column > indent && column + 1 + width > kColumns) {
      result += line_end;
      column = indent;
    } else if (column > indent) {
      result += ' ';
      ++column;
    }
    result += word;
    column += width;
    at += word.size();
  }
  return result;
}

}  // namespace

std::vector<std::string_view> split_text(std::string_view text, std::string_view separator) {
  std::vector<std::string_view> parts;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find(separator), text.size());
    parts.push_back(text.substr(0, end));
    text.remove_prefix(std::min(end + separator.size(), text.size()));
  }
  return parts;
}

bool laid_out(std::string_view paragraph) {
  return paragraph.starts_with(' ') || paragraph.find("\n ") != std::string_view::npos ||
         paragraph.find("  ") != std::string_view::npos;
}

std::string filled(std::string_view text, std::size_t indent) {
  const std::string line_end = "\n" + std::string(indent, ' ');
  std::string result;
  for (const std::string_view paragraph : split_text(text, "\n\n")) {
    if (!result.empty()) result += "\n" + line_end;
    if (!laid_out(paragraph)) {
      result += filled_paragraph(paragraph, indent);
      continue;
    }
    const auto lines = split_text(paragraph, "\n");
    for (std::size_t i = 0; i < lines.size(); ++i) result += (i == 0 ? "" : line_end) + std::string(lines[i]);
  }
  return result;
}

}  // namespace nadir
