// Strict JSON (RFC 8259) for documents that are signed or come from outside: a parser and a reader.
//
// nlohmann/json accepts more than we want to accept. parse_json() refuses duplicate keys, deep nesting and (for signed
// documents) floating-point numbers before a document is built. JsonReader then takes the members of an object or the
// elements of an array one by one and checks type, range and length of each. Whatever does not fit is a JsonError that
// states where (the document's name and a JSON pointer, RFC 6901), what was expected and what was found.
//
//   const nlohmann::json document = parse_json(text, name, {.max_depth = 4, .allow_floats = false});
//   const JsonReader in(document, {.name = name, .what = "cannot accept these poses"});
//   in.expect("schema", "nadir.poses/1");
//   const auto zoom = in.integer<int>("zoom", 0, kMaxZoom);
//   const JsonReader tiles = in.array("tiles", {.least = 1, .most = 256});
//   for (std::size_t i = 0; i < tiles.size(); ++i) { const JsonReader tile = tiles.object(i); ...; tile.finish(); }
//   in.finish();  // nothing else may be there
#pragma once

#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/time.hpp"

namespace nadir {

struct JsonLimits {
  int max_depth = 16;
  bool allow_floats = true;
};

// Throws Error (what, where = name, found) for anything that is not exactly one acceptable document.
nlohmann::json parse_json(std::string_view text, std::string_view name, const JsonLimits& limits = {});

class JsonError : public Error {
 public:
  JsonError(ErrorText text, std::string pointer) : Error(std::move(text)), pointer_(std::move(pointer)) {}
  // The place in the document alone: "/tiles/3/sha256"; the name of the document is in text().where.
  const std::string& pointer() const { return pointer_; }

 private:
  std::string pointer_;
};

// A member of an object by its name, or an element of an array by its index.
class JsonKey {
 public:
  JsonKey(const char* name) : name_(name) {}         // NOLINT(google-explicit-constructor): keys are written in place
  JsonKey(std::string_view name) : name_(name) {}    // NOLINT(google-explicit-constructor)
  JsonKey(const std::string& name) : name_(name) {}  // NOLINT(google-explicit-constructor)
  template <std::integral Index>
  JsonKey(Index index) : index_(static_cast<std::size_t>(index)) {}  // NOLINT(google-explicit-constructor)

  const std::optional<std::size_t>& index() const { return index_; }
  std::string_view name() const { return name_; }

 private:
  std::string_view name_;
  std::optional<std::size_t> index_;
};

// Bounds of the number of bytes of a text or of the elements of an array.
struct JsonLength {
  std::size_t least = 0;
  std::size_t most = std::numeric_limits<std::size_t>::max();
};

class JsonReader {
 public:
  // What each error of a document states.
  struct Subject {
    std::string name;  // the document: a path, "the service's answer"
    std::string what;  // "cannot accept these poses"
    std::string fix{};
  };

  // The document must be an object and must outlive its readers.
  JsonReader(const nlohmann::json& document, Subject subject);
  JsonReader(nlohmann::json&& document, Subject subject) = delete;
  JsonReader(JsonReader&&) noexcept = default;
  JsonReader& operator=(JsonReader&&) noexcept = default;
  JsonReader(const JsonReader&) = delete;  // members count as read per reader
  JsonReader& operator=(const JsonReader&) = delete;

  const nlohmann::json& json() const { return *value_; }
  const std::string& pointer() const { return pointer_; }  // "" for the document itself
  std::string where() const;                               // "poses.json /poses/3"
  std::string where(JsonKey key) const;

  // Each of these throws JsonError when the member is absent, of another type or out of its bounds.
  const nlohmann::json& value(JsonKey key) const;  // any type
  JsonReader object(JsonKey key) const;
  JsonReader array(JsonKey key, JsonLength length = {}) const;
  const std::string& text(JsonKey key, JsonLength bytes = {}) const;
  double number(JsonKey key, double least = std::numeric_limits<double>::lowest(),
                double most = std::numeric_limits<double>::max()) const;
  template <std::integral Integer = std::int64_t>
  Integer integer(JsonKey key, std::type_identity_t<Integer> least, std::type_identity_t<Integer> most) const {
    return static_cast<Integer>(
        checked_integer(key, static_cast<std::int64_t>(least), static_cast<std::int64_t>(most)));
  }
  bool boolean(JsonKey key) const;
  Sha256 digest(JsonKey key) const;  // 64 lower-case hexadecimal digits
  UtcTime time(JsonKey key) const;   // as parse_utc() takes it
  void expect(JsonKey key, std::string_view text) const;

  // One of these texts, or the value whose name_of() is the text.
  std::string_view choice(JsonKey key, std::initializer_list<std::string_view> words) const;
  template <typename Values>
  auto choice(JsonKey key, const Values& values) const {
    const std::string& found = text(key);
    std::vector<std::string> names;
    for (const auto& one : values) {
      if (found == name_of(one)) return one;
      names.emplace_back(name_of(one));
    }
    refuse_choice(key, names);
  }

  // nullopt when the member is absent; null is a value of another type.
  bool has(JsonKey key) const;
  bool is_null(JsonKey key) const;  // the member must be there
  std::optional<JsonReader> optional_object(JsonKey key) const;
  std::optional<JsonReader> optional_array(JsonKey key, JsonLength length = {}) const;
  std::optional<std::string> optional_text(JsonKey key, JsonLength bytes = {}) const;
  std::optional<double> optional_number(JsonKey key, double least = std::numeric_limits<double>::lowest(),
                                        double most = std::numeric_limits<double>::max()) const;
  template <std::integral Integer = std::int64_t>
  std::optional<Integer> optional_integer(JsonKey key, std::type_identity_t<Integer> least,
                                          std::type_identity_t<Integer> most) const {
    return has(key) ? std::optional(integer<Integer>(key, least, most)) : std::nullopt;
  }
  std::optional<bool> optional_boolean(JsonKey key) const;
  std::optional<UtcTime> optional_time(JsonKey key) const;

  // An array's elements, an object's members. An object whose keys are data: all of them count as read.
  std::size_t size() const;
  std::vector<std::string> keys() const;

  // Rejects members that have not been read, except those whose names begin with the prefix (unless it is empty).
  void finish(std::string_view ignored_prefix = {}) const;

  // For the caller's own checks. "Found" is the member itself, the whole value, or the given text.
  [[noreturn]] void refuse(JsonKey key, std::string expected) const;
  [[noreturn]] void refuse(JsonKey key, std::string expected, const nlohmann::json& found) const;
  [[noreturn]] void refuse(std::string expected) const;

 private:
  JsonReader(const nlohmann::json& value, std::shared_ptr<const Subject> subject, std::string pointer);
  const nlohmann::json* find(JsonKey key) const;
  std::string pointer_of(JsonKey key) const;
  std::int64_t checked_integer(JsonKey key, std::int64_t least, std::int64_t most) const;
  [[noreturn]] void refuse_at(std::string pointer, std::string expected, std::string found) const;
  [[noreturn]] void refuse_choice(JsonKey key, const std::vector<std::string>& names) const;

  const nlohmann::json* value_;
  std::shared_ptr<const Subject> subject_;
  std::string pointer_;
  mutable std::vector<const nlohmann::json*> read_;  // members of an object
};

}  // namespace nadir
