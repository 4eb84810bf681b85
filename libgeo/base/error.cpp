#include "base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
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

// The fields that errors and findings share.
template <typename Text>
std::string with_lines(std::string message, const Text& text) {
  append_line(message, "where:    ", text.where);
  append_line(message, "expected: ", text.expected);
  append_line(message, "found:    ", text.found);
  append_line(message, "to do:    ", text.fix);
  return message;
}

}  // namespace

Error::Error(ErrorText text) : std::runtime_error(with_lines(printable(text.what), text)), text_(std::move(text)) {}

std::string system_error_text(int error_number) { return std::system_category().message(error_number); }

std::string_view name_of(Severity severity) {
  switch (severity) {
    case Severity::note: return "note";
    case Severity::warning: return "warning";
    case Severity::error: return "refuse";
  }
  return "refuse";
}

void Findings::add(const Findings& others) { items_.insert(items_.end(), others.items_.begin(), others.items_.end()); }

bool Findings::has_errors() const {
  return std::any_of(items_.begin(), items_.end(),
                     [](const Finding& finding) { return finding.severity == Severity::error; });
}

bool Findings::contains(std::string_view code) const {
  return std::any_of(items_.begin(), items_.end(), [code](const Finding& finding) { return finding.code == code; });
}

std::string to_text(const Finding& finding) {
  const std::string_view severity = finding.severity == Severity::error ? "error" : name_of(finding.severity);
  return with_lines(fmt::format("{} ({})", printable(finding.code), severity), finding);
}

}  // namespace nadir
