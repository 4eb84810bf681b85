#include "api/requests.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"

namespace nadir {
namespace {

constexpr int kMaxDepth = 4;

// "application/json", with parameters or not.
bool is_json(std::string_view content_type) {
  std::string type(content_type.substr(0, content_type.find(';')));
  while (!type.empty() && (type.back() == ' ' || type.back() == '\t')) type.pop_back();
  std::transform(type.begin(), type.end(), type.begin(), [](unsigned char c) { return std::tolower(c); });
  return type == "application/json";
}

}  // namespace

BodyFields::BodyFields(const nlohmann::json& value, std::string pointer, std::vector<FieldError>& errors)
    : value_(&value), pointer_(std::move(pointer)), errors_(&errors) {
  if (!value.is_object()) errors.push_back({pointer_, "must be an object"});
}

const nlohmann::json* BodyFields::find(std::string_view name) {
  known_.emplace_back(name);
  if (!value_->is_object()) return nullptr;
  const auto member = value_->find(known_.back());
  return member == value_->end() ? nullptr : &*member;
}

void BodyFields::note(std::string_view name, std::string detail) const {
  errors_->push_back({fmt::format("{}/{}", pointer_, name), std::move(detail)});
}

double BodyFields::checked(std::string_view name, const nlohmann::json& value, NumberRange range) const {
  if (!value.is_number()) {
    note(name, "must be a number");
    return 0;
  }
  const double number = value.get<double>();
  const bool inside = number <= range.high && (range.above_low ? number > range.low : number >= range.low);
  if (!inside) {
    note(name, fmt::format("must be {} {} and at most {}, is {}", range.above_low ? "above" : "at least", range.low,
                           range.high, number));
  }
  return number;
}

double BodyFields::number(std::string_view name, NumberRange range) {
  if (const nlohmann::json* value = find(name)) return checked(name, *value, range);
  if (value_->is_object()) note(name, "is missing");
  return 0;
}

std::optional<double> BodyFields::optional_number(std::string_view name, NumberRange range) {
  if (const nlohmann::json* value = find(name)) return checked(name, *value, range);
  return std::nullopt;
}

int BodyFields::whole_number(std::string_view name, int low, int high) {
  const std::size_t before = errors_->size();
  const double value = number(name, {.low = static_cast<double>(low), .high = static_cast<double>(high)});
  if (errors_->size() != before) return low;
  if (value != std::floor(value)) note(name, "must be a whole number");
  return static_cast<int>(value);
}

std::optional<std::string> BodyFields::optional_word(std::string_view name, const std::vector<std::string>& choices) {
  const nlohmann::json* value = find(name);
  if (value == nullptr) return std::nullopt;
  if (value->is_string()) {
    std::string word = value->get<std::string>();
    if (std::find(choices.begin(), choices.end(), word) != choices.end()) return word;
  }
  note(name, fmt::format("must be one of {}", fmt::join(choices, ", ")));
  return std::nullopt;
}

std::vector<double> BodyFields::numbers(std::string_view name, std::size_t count, NumberRange range) {
  const nlohmann::json* value = find(name);
  if (value == nullptr) return {};
  if (!value->is_array() || value->size() != count) {
    note(name, fmt::format("must be a list of {} numbers", count));
    return {};
  }
  std::vector<double> numbers;
  numbers.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    numbers.push_back(checked(fmt::format("{}/{}", name, i), (*value)[i], range));
  }
  return numbers;
}

std::optional<BodyFields> BodyFields::object(std::string_view name) {
  const nlohmann::json* value = find(name);
  if (value == nullptr) return std::nullopt;
  return BodyFields(*value, fmt::format("{}/{}", pointer_, name), *errors_);
}

void BodyFields::nothing_else() const {
  if (!value_->is_object()) return;
  for (const auto& [name, value] : value_->items()) {
    if (std::find(known_.begin(), known_.end(), name) == known_.end()) note(name, "is not known here");
  }
}

std::optional<Problem> read_body(const ApiRequest& request, nlohmann::json& value) {
  if (!is_json(request.content_type)) {
    return Problem{.status = 415, .type = "media-type", .detail = "send the body as Content-Type: application/json"};
  }
  try {
    value = parse_json(request.body, "body", {.max_depth = kMaxDepth, .allow_floats = true});
  } catch (const Error& error) {
    return Problem{
        .status = 400,
        .type = "malformed",
        .detail = fmt::format("the body is not acceptable JSON: {} {}", error.text().what, error.text().found)};
  }
  return std::nullopt;
}

std::optional<Problem> problem_with(std::vector<FieldError> errors) {
  if (errors.empty()) return std::nullopt;
  return Problem{.status = 400,
                 .type = "invalid",
                 .detail = "the body is not what this call takes; \"errors\" lists why",
                 .errors = std::move(errors)};
}

}  // namespace nadir
