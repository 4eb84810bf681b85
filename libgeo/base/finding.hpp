// Results of checks. Checking does not throw: it collects everything that is wrong and lets the caller decide.
//
// Codes are stable and documented in docs/findings.md ("tiles.root", "coverage.gap"); scripts may rely on them.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace nadir {

enum class Severity { note, warning, refuse };

std::string_view name_of(Severity severity);

struct Finding {
  std::string code;
  Severity severity = Severity::refuse;
  std::string where{};
  std::string expected{};
  std::string found{};
  std::string fix{};
};

class Findings {
 public:
  void add(Finding finding) { items_.push_back(std::move(finding)); }
  void add(const Findings& others);

  // True when at least one finding means that the subject must not be used (exit code 1).
  bool refuses() const;
  bool contains(std::string_view code) const;
  bool empty() const { return items_.empty(); }
  const std::vector<Finding>& items() const { return items_; }

 private:
  std::vector<Finding> items_;
};

// One finding as lines for people: code, severity, where, expected, found, fix.
std::string to_text(const Finding& finding);

}  // namespace nadir
