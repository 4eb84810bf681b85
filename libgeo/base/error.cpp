#include "base/error.hpp"

#include <system_error>

#include "base/printable.hpp"

namespace nadir {
namespace {

void append_line(std::string& message, const char* label, const std::string& value) {
  if (value.empty()) return;
  message += "\n  ";
  message += label;
  message += printable(value);
}

std::string render(const ErrorText& text) {
  std::string message = printable(text.what);
  append_line(message, "where:    ", text.where);
  append_line(message, "expected: ", text.expected);
  append_line(message, "found:    ", text.found);
  append_line(message, "to do:    ", text.fix);
  return message;
}

}  // namespace

Error::Error(ErrorText text) : std::runtime_error(render(text)), text_(std::move(text)) {}

std::string system_error_text(int error_number) { return std::system_category().message(error_number); }

}  // namespace nadir
