// Answers to requests that cannot be served: application/problem+json (RFC 9457).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "http/message.hpp"

namespace nadir {

struct FieldError {
  std::string pointer;  // where in the body (RFC 6901): "/pixel/x"
  std::string detail;
};

// type: a word that programs can tell problems apart by; it appears as "urn:nadir:problem:TYPE".
struct Problem {
  int status = 400;
  std::string type;
  std::string detail;  // what is wrong and what to do about it
  std::vector<FieldError> errors{};
};

ApiResponse answer(const Problem& problem);

}  // namespace nadir
