// The exception of this project: the job could not be done (exit code 2).
//
// What a check finds wrong with its subject is no exception but a Finding (finding.hpp, exit code 1).
// Every error tells a tired operator five things: what went wrong, where, what was expected, what was found
// instead, and what to do about it. Leave a field empty only where it would repeat another one.
#pragma once

#include <stdexcept>
#include <string>

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

// The disk or the quota is full: what has been done so far is worth keeping.
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

}  // namespace nadir
