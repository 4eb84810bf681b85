#include "base/finding.hpp"

#include <algorithm>

#include "base/printable.hpp"

namespace nadir {
std::string_view name_of(Severity severity) {
  switch (severity) {
    case Severity::note: return "note";
    case Severity::warning: return "warning";
    case Severity::refuse: return "refuse";
  }
  return "refuse";
}

void Findings::add(const Findings& others) { items_.insert(items_.end(), others.items_.begin(), others.items_.end()); }

bool Findings::refuses() const {
  return std::any_of(items_.begin(), items_.end(),
                     [](const Finding& finding) { return finding.severity == Severity::refuse; });
}

bool Findings::contains(std::string_view code) const {
  return std::any_of(items_.begin(), items_.end(), [code](const Finding& finding) { return finding.code == code; });
}

std::string to_text(const Finding& finding) {
  std::string text = finding.code + " (" + std::string(name_of(finding.severity)) + ")";
  const auto line = [&text](const char* label, const std::string& value) {
    if (!value.empty()) text += std::string("\n  ") + label + printable(value);
  };
  line("where:    ", finding.where);
  line("expected: ", finding.expected);
  line("found:    ", finding.found);
  line("to do:    ", finding.fix);
  return text;
}

}  // namespace nadir
