#include "http/json_body.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace nadir {
namespace {

constexpr int kMaxDepth = 4;

}  // namespace

std::optional<double> BodyFields::optional_number(const char* name, NumberRange range) {
  if (!find(name)) return std::nullopt;
  return checked(in_, name, range);
}

double BodyFields::number(const char* name, NumberRange range) {
  if (find(name)) return checked(in_, name, range);
  note(name, "is missing");
  return 0;
}

int BodyFields::integer(const char* name, int low, int high) {
  const std::size_t before = errors_->size();
  const double value = number(name, {.low = static_cast<double>(low), .high = static_cast<double>(high)});
  if (errors_->size() != before) return low;
  if (value != std::floor(value)) note(name, "must be an integer");
  return static_cast<int>(value);
}

std::optional<int> BodyFields::optional_integer(const char* name, int low, int high) {
  if (!find(name)) return std::nullopt;
  return integer(name, low, high);
}

std::optional<bool> BodyFields::optional_boolean(const char* name) {
  std::optional<bool> value;
  if (find(name)) collect([&] { value = in_.boolean(name); });
  return value;
}

std::string BodyFields::text(const char* name, JsonLength bytes) {
  if (auto found = optional_text(name, bytes)) return *std::move(found);
  if (!in_.has(name)) note(name, "is missing");
  return {};
}

std::optional<std::string> BodyFields::optional_text(const char* name, JsonLength bytes) {
  if (!find(name)) return std::nullopt;
  std::optional<std::string> text;
  collect([&] { text = in_.text(name, bytes); });
  return text;
}

std::optional<std::string> BodyFields::optional_word(const char* name,
                                                     std::initializer_list<std::string_view> choices) {
  if (!find(name)) return std::nullopt;
  std::optional<std::string> word;
  collect([&] { word = std::string(in_.choice(name, choices)); });
  return word;
}

std::vector<double> BodyFields::optional_numbers(const char* name, std::size_t count, NumberRange range) {
  std::vector<double> numbers;
  if (!find(name)) return numbers;
  collect([&] {
    const JsonReader list = in_.array(name, {.least = count, .most = count});
    for (std::size_t i = 0; i < count; ++i) numbers.push_back(checked(list, i, range));
  });
  return numbers;
}

std::optional<BodyFields> BodyFields::optional_object(const char* name) {
  std::optional<BodyFields> fields;
  if (find(name)) collect([&] { fields.emplace(in_.object(name), *errors_); });
  return fields;
}

std::vector<BodyFields> BodyFields::objects(const char* name, JsonLength length) {
  std::vector<BodyFields> list;
  if (!find(name)) {
    note(name, "is missing");
    return list;
  }
  collect([&] {
    const JsonReader array = in_.array(name, length);
    for (std::size_t i = 0; i < array.size(); ++i) list.emplace_back(array.object(i), *errors_);
  });
  return list;
}

void BodyFields::finish() const {
  for (const std::string& name : in_.keys()) {
    if (std::find(known_.begin(), known_.end(), name) == known_.end()) note(name, "is unknown");
  }
}

bool BodyFields::find(const char* name) {
  known_.emplace_back(name);
  return in_.has(name);
}

void BodyFields::note(std::string_view name, std::string detail) const {
  errors_->push_back({fmt::format("{}/{}", in_.pointer(), name), std::move(detail)});
}

template <typename Read>
void BodyFields::collect(const Read& read) const {
  try {
    read();
  } catch (const JsonError& error) {
    errors_->push_back({error.pointer(), fmt::format("must be {}, is {}", error.text().expected, error.text().found)});
  }
}

double BodyFields::checked(const JsonReader& in, JsonKey key, NumberRange range) const {
  double number = 0;
  collect([&] {
    number = in.number(key);
    const bool inside = number <= range.high && (range.above_low ? number > range.low : number >= range.low);
    if (inside) return;
    in.refuse(key, fmt::format("{} {} and at most {}", range.above_low ? "above" : "at least", range.low, range.high));
  });
  return number;
}

std::optional<Problem> read_json_object(std::string_view text,
                                        const std::function<void(BodyFields&, FieldErrors&)>& read) {
  nlohmann::json document;
  try {
    document = parse_json(text, "body", {.max_depth = kMaxDepth, .allow_floats = true});
  } catch (const Error& error) {
    return Problem{
        .status = 400, .type = "malformed", .detail = "the body is not acceptable JSON: " + error.text().found};
  }
  FieldErrors errors;
  if (document.is_object()) {
    BodyFields fields(JsonReader(document, {.name = "body", .what = "cannot accept this body"}), errors);
    read(fields, errors);
    fields.finish();
  } else {
    errors.push_back({"", "must be an object"});
  }
  if (errors.empty()) return std::nullopt;
  return Problem{.status = 400,
                 .type = "invalid",
                 .detail = "the body does not match this call; \"errors\" lists why",
                 .errors = std::move(errors)};
}

std::optional<Problem> read_json_body(const ApiRequest& request,
                                      const std::function<void(BodyFields&, FieldErrors&)>& read) {
  if (media_type(request.content_type) != "application/json") {
    return Problem{.status = 415, .type = "media-type", .detail = "send the body as Content-Type: application/json"};
  }
  return read_json_object(request.body, read);
}

}  // namespace nadir
