// Exceptions and findings. An Error means that the job could not be done (exit code 2). What a check finds wrong with
// its subject is not an exception but a Finding (exit code 1): checks collect everything that is wrong and let the
// caller decide.
//
// Both answer five questions of an operator: what is wrong, where, what was expected, what was found instead, and what
// to do about it. Leave a field empty only where it would repeat another one.
//
// Codes of findings are stable and documented in docs/findings.md ("tiles.root", "coverage.gap"); scripts may rely on
// them.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace nadir {

struct ErrorText {
  std::string what;
  std::string where{};
  std::string expected{};
  std::string found{};
  std::string fix{};
};

class Error : public std::runtime_error {
 public:
  explicit Error(ErrorText text);

  const ErrorText& text() const { return text_; }

 private:
  ErrorText text_;
};

// The command line was wrong, or an input does not have the form that the command asks for. Also exit code 2.
class UsageError : public Error {
 public:
  using Error::Error;
};

// The disk or the quota is full. Keep what has been done so far.
class OutOfSpace : public Error {
 public:
  using Error::Error;
};

// The user or the system asked us to stop (exit code 130).
class Interrupted : public std::runtime_error {
 public:
  Interrupted() : std::runtime_error("interrupted") {}
};

// The text of errno for messages: "No space left on device".
std::string system_error_text(int error_number);

// An error means that the subject must not be used.
enum class Severity { note, warning, error };

// The name in JSON, CSV and Markdown: an error is "refuse" there.
std::string_view name_of(Severity severity);

struct Finding {
  std::string code;
  Severity severity = Severity::error;
  std::string where{};
  std::string expected{};
  std::string found{};
  std::string fix{};
};

class Findings {
 public:
  void add(Finding finding) { items_.push_back(std::move(finding)); }
  void add(const Findings& others);

  // True when the subject is rejected (exit code 1).
  bool has_errors() const;
  bool contains(std::string_view code) const;
  bool empty() const { return items_.empty(); }
  const std::vector<Finding>& items() const { return items_; }

 private:
  std::vector<Finding> items_;
};

// One finding as lines for people: code, severity, where, expected, found, fix.
std::string to_text(const Finding& finding);

}  // namespace nadir
