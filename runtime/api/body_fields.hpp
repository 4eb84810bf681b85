// Reads the members of a JSON body and notes everything that is wrong with them, so that a caller learns all of it from
// one answer.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "http/message.hpp"

namespace nadir {

struct NumberRange {
  double low = 0, high = 0;
  bool above_low = false;  // low itself is out
};

class BodyFields {
 public:
  // value: must be an object, else that is noted and it reads as an empty one. Both must outlive this.
  BodyFields(const nlohmann::json& value, std::string pointer, std::vector<FieldError>& errors);

  // Notes what is missing or wrong; then the result means nothing.
  double number(std::string_view name, NumberRange range);
  std::optional<double> optional_number(std::string_view name, NumberRange range);
  int whole_number(std::string_view name, int low, int high);
  std::optional<std::string> optional_word(std::string_view name, const std::vector<std::string>& choices);
  std::vector<double> numbers(std::string_view name, std::size_t count, NumberRange range);  // empty: absent
  std::optional<BodyFields> object(std::string_view name);                                   // nullopt: absent

  // Members that nobody asked for by now are errors: a misspelt name must not be silently left out.
  void nothing_else() const;

 private:
  const nlohmann::json* find(std::string_view name);
  void note(std::string_view name, std::string detail) const;
  double checked(std::string_view name, const nlohmann::json& value, NumberRange range) const;

  const nlohmann::json* value_;
  std::string pointer_;
  std::vector<FieldError>* errors_;
  std::vector<std::string> known_;
};

// Reads the body as strict JSON into `value`; the problem with it when it is none.
std::optional<Problem> read_body(const ApiRequest& request, nlohmann::json& value);

// What a list of errors is to the caller; nullopt when it is empty.
std::optional<Problem> problem_with(std::vector<FieldError> errors);

}  // namespace nadir
