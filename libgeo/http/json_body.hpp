// The JSON body of a request: read strictly, with all that is wrong with it in one answer.
//
//   auto parsed = read_body<Hint>(request, [](BodyFields& body, FieldErrors& errors) {
//     Hint hint;
//     hint.radius_m = body.number("radius_m", {.low = 0, .high = 100'000, .above_low = true});
//     return hint;
//   });
//   if (const auto* problem = std::get_if<Problem>(&parsed)) return answer(*problem);
#pragma once

#include <functional>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "base/json.hpp"
#include "http/message.hpp"

namespace nadir {

using FieldErrors = std::vector<FieldError>;

struct NumberRange {
  double low = 0, high = 0;
  bool above_low = false;  // low itself is out
};

// A JsonReader that notes what is wrong with an object's members instead of throwing. What is missing or wrong reads as
// 0 or empty; the result is then meaningless.
class BodyFields {
 public:
  // errors: must outlive this.
  BodyFields(JsonReader in, FieldErrors& errors) : in_(std::move(in)), errors_(&errors) {}

  std::optional<double> optional_number(const char* name, NumberRange range);
  double number(const char* name, NumberRange range);
  int integer(const char* name, int low, int high);
  std::optional<int> optional_integer(const char* name, int low, int high);
  std::optional<bool> optional_boolean(const char* name);
  std::string text(const char* name, JsonLength bytes);
  std::optional<std::string> optional_text(const char* name, JsonLength bytes);
  std::optional<std::string> optional_word(const char* name, std::initializer_list<std::string_view> choices);
  std::vector<double> optional_numbers(const char* name, std::size_t count, NumberRange range);
  std::optional<BodyFields> optional_object(const char* name);
  std::vector<BodyFields> objects(const char* name, JsonLength length);  // the elements of an array

  // Members that have not been read are errors: a misspelt name must not be silently ignored.
  void finish() const;

 private:
  bool find(const char* name);
  void note(std::string_view name, std::string detail) const;
  template <typename Read>
  void collect(const Read& read) const;
  double checked(const JsonReader& in, JsonKey key, NumberRange range) const;

  JsonReader in_;
  FieldErrors* errors_;
  std::vector<std::string> known_;
};

// Reads an object: why it cannot be (415, 400 "malformed", 400 "invalid" with its errors), or nothing.
std::optional<Problem> read_json_body(const ApiRequest& request,
                                      const std::function<void(BodyFields&, FieldErrors&)>& read);
std::optional<Problem> read_json_object(std::string_view text,
                                        const std::function<void(BodyFields&, FieldErrors&)>& read);

// read(fields, errors): the value.
template <typename Value, typename Read>
std::variant<Value, Problem> read_body(const ApiRequest& request, const Read& read) {
  Value value;
  auto problem =
      read_json_body(request, [&](BodyFields& fields, FieldErrors& errors) { value = read(fields, errors); });
  if (problem) return std::move(*problem);
  return value;
}

}  // namespace nadir
