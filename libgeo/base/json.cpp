#include "base/json.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

namespace nadir {
namespace {

constexpr std::size_t kMaxQuoted = 80;  // bytes of a document in a message

// Hostile text: escape what is not ASCII, replace what is not UTF-8, and cut it.
std::string quote_json(const nlohmann::json& value) {
  std::string text = value.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
  if (text.size() > kMaxQuoted) text = text.substr(0, kMaxQuoted - 3) + "...";
  return text;
}

// A name as a token of a JSON pointer (RFC 6901), with the escapes of JSON for what is not printable.
std::string pointer_token(std::string_view name) {
  std::string token;
  for (const char c : name.substr(0, kMaxQuoted)) {
    if (c == '~') {
      token += "~0";
    } else if (c == '/') {
      token += "~1";
    } else {
      token += c;
    }
  }
  const std::string escaped = nlohmann::json(token).dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
  return escaped.substr(1, escaped.size() - 2);
}

std::string bounds_text(std::string_view noun, JsonLength length, std::string_view unit) {
  if (length.most == std::numeric_limits<std::size_t>::max()) {
    return length.least == 0 ? std::string(noun) : fmt::format("{} of at least {} {}", noun, length.least, unit);
  }
  if (length.least == length.most) return fmt::format("{} of {} {}", noun, length.least, unit);
  if (length.least == 0) return fmt::format("{} of at most {} {}", noun, length.most, unit);
  return fmt::format("{} of {} to {} {}", noun, length.least, length.most, unit);
}

bool within(std::size_t size, JsonLength length) { return size >= length.least && size <= length.most; }

// "[json.exception.parse_error.101] parse error at line 1, column 2: …" begins with a prefix that means nothing to
// the user. The rest is plain English.
std::string_view without_library_prefix(std::string_view text) {
  constexpr std::string_view kParseError = "parse error at ";
  const std::size_t end = text.starts_with('[') ? text.find("] ") : std::string_view::npos;
  if (end != std::string_view::npos) text.remove_prefix(end + 2);
  if (text.starts_with(kParseError)) text.remove_prefix(kParseError.size());
  return text;
}

// Walks the document without building it and notes the first thing that we do not accept.
class JsonGuard final : public nlohmann::json_sax<nlohmann::json> {
 public:
  explicit JsonGuard(const JsonLimits& limits) : limits_(limits) {}

  const std::string& fault() const { return fault_; }

  bool null() override { return true; }
  bool boolean(bool) override { return true; }
  bool number_integer(number_integer_t) override { return true; }
  bool number_unsigned(number_unsigned_t) override { return true; }
  bool number_float(number_float_t, const string_t& text) override {
    return limits_.allow_floats || note("the number " + text + ", where only whole numbers are allowed");
  }
  bool string(string_t&) override { return true; }
  bool binary(binary_t&) override { return true; }
  bool start_object(std::size_t) override {
    keys_.emplace_back();
    return deeper();
  }
  bool key(string_t& name) override {
    return keys_.back().insert(name).second || note("the key \"" + name + "\" twice in one object");
  }
  bool end_object() override {
    keys_.pop_back();
    --depth_;
    return true;
  }
  bool start_array(std::size_t) override { return deeper(); }
  bool end_array() override {
    --depth_;
    return true;
  }
  bool parse_error(std::size_t position, const std::string&, const nlohmann::detail::exception& error) override {
    return note(fmt::format("at byte {}: {}", position, without_library_prefix(error.what())));
  }

 private:
  bool deeper() { return ++depth_ <= limits_.max_depth || note("too deeply nested"); }
  bool note(std::string text) {
    fault_ = std::move(text);
    return false;
  }

  JsonLimits limits_;
  std::string fault_;
  std::vector<std::set<std::string>> keys_;
  int depth_ = 0;
};

}  // namespace

nlohmann::json parse_json(std::string_view text, std::string_view name, const JsonLimits& limits) {
  JsonGuard guard(limits);
  if (!nlohmann::json::sax_parse(text, &guard)) {
    throw Error({.what = "cannot accept this JSON", .where = std::string(name), .found = guard.fault()});
  }
  return nlohmann::json::parse(text);
}

JsonReader::JsonReader(const nlohmann::json& document, Subject subject)
    : value_(&document), subject_(std::make_shared<const Subject>(std::move(subject))) {
  if (!document.is_object()) refuse("an object");
}

JsonReader::JsonReader(const nlohmann::json& value, std::shared_ptr<const Subject> subject, std::string pointer)
    : value_(&value), subject_(std::move(subject)), pointer_(std::move(pointer)) {}

std::string JsonReader::pointer_of(JsonKey key) const {
  return key.index() ? fmt::format("{}/{}", pointer_, *key.index())
                     : fmt::format("{}/{}", pointer_, pointer_token(key.name()));
}

std::string JsonReader::where() const {
  return pointer_.empty() ? subject_->name : fmt::format("{} {}", subject_->name, pointer_);
}

std::string JsonReader::where(JsonKey key) const { return fmt::format("{} {}", subject_->name, pointer_of(key)); }

void JsonReader::refuse_at(std::string pointer, std::string expected, std::string found) const {
  throw JsonError({.what = subject_->what,
                   .where = pointer.empty() ? subject_->name : fmt::format("{} {}", subject_->name, pointer),
                   .expected = std::move(expected),
                   .found = std::move(found),
                   .fix = subject_->fix},
                  pointer);
}

void JsonReader::refuse(JsonKey key, std::string expected, const nlohmann::json& found) const {
  refuse_at(pointer_of(key), std::move(expected), quote_json(found));
}

void JsonReader::refuse(JsonKey key, std::string expected) const {
  const nlohmann::json* found = find(key);
  refuse_at(pointer_of(key), std::move(expected), found == nullptr ? "none" : quote_json(*found));
}

void JsonReader::refuse(std::string expected) const { refuse_at(pointer_, std::move(expected), quote_json(*value_)); }

const nlohmann::json* JsonReader::find(JsonKey key) const {
  if (key.index()) return *key.index() < size() ? &(*value_)[*key.index()] : nullptr;
  if (!value_->is_object()) return nullptr;
  const auto found = value_->find(key.name());
  if (found == value_->end()) return nullptr;
  read_.push_back(&*found);
  return &*found;
}

const nlohmann::json& JsonReader::value(JsonKey key) const {
  const nlohmann::json* found = find(key);
  if (found == nullptr) {
    refuse_at(pointer_,
              key.index() ? fmt::format("an element {}", *key.index())
                          : fmt::format("a member \"{}\"", pointer_token(key.name())),
              "none");
  }
  return *found;
}

JsonReader JsonReader::object(JsonKey key) const {
  const nlohmann::json& found = value(key);
  if (!found.is_object()) refuse(key, "an object", found);
  return {found, subject_, pointer_of(key)};
}

JsonReader JsonReader::array(JsonKey key, JsonLength length) const {
  const nlohmann::json& found = value(key);
  if (!found.is_array()) refuse(key, bounds_text("an array", length, "elements"), found);
  if (!within(found.size(), length)) {
    refuse_at(pointer_of(key), bounds_text("an array", length, "elements"), fmt::format("{}", found.size()));
  }
  return {found, subject_, pointer_of(key)};
}

const std::string& JsonReader::text(JsonKey key, JsonLength bytes) const {
  const nlohmann::json& found = value(key);
  const auto* text = found.get_ptr<const std::string*>();
  if (text == nullptr || !within(text->size(), bytes)) refuse(key, bounds_text("text", bytes, "bytes"), found);
  return *text;
}

double JsonReader::number(JsonKey key, double least, double most) const {
  const nlohmann::json& found = value(key);
  const bool fits = found.is_number() && found.get<double>() >= least && found.get<double>() <= most;
  if (!fits) {
    const bool bounded = least > std::numeric_limits<double>::lowest() || most < std::numeric_limits<double>::max();
    refuse(key, bounded ? fmt::format("a number from {} to {}", least, most) : "a number", found);
  }
  return found.get<double>();
}

std::int64_t JsonReader::checked_integer(JsonKey key, std::int64_t least, std::int64_t most) const {
  const nlohmann::json& found = value(key);
  const bool fits = found.is_number_integer() &&
                    !(found.is_number_unsigned() && found.get<std::uint64_t>() > std::uint64_t{1} << 62) &&
                    found.get<std::int64_t>() >= least && found.get<std::int64_t>() <= most;
  if (!fits) refuse(key, fmt::format("an integer from {} to {}", least, most), found);
  return found.get<std::int64_t>();
}

bool JsonReader::boolean(JsonKey key) const {
  const nlohmann::json& found = value(key);
  if (!found.is_boolean()) refuse(key, "true or false", found);
  return found.get<bool>();
}

Sha256 JsonReader::digest(JsonKey key) const {
  const auto digest = Sha256::from_hex(text(key));
  if (!digest) refuse(key, "64 lower-case hexadecimal digits");
  return *digest;
}

UtcTime JsonReader::time(JsonKey key) const {
  const auto time = parse_utc(text(key));
  if (!time) refuse(key, "a time like 2030-01-01T00:00:00Z");
  return *time;
}

void JsonReader::expect(JsonKey key, std::string_view expected) const {
  if (text(key) != expected) refuse(key, fmt::format("\"{}\"", expected));
}

std::string_view JsonReader::choice(JsonKey key, std::initializer_list<std::string_view> words) const {
  const auto found = std::find(words.begin(), words.end(), text(key));
  if (found == words.end()) refuse_choice(key, {words.begin(), words.end()});
  return *found;
}

void JsonReader::refuse_choice(JsonKey key, const std::vector<std::string>& names) const {
  refuse(key, fmt::format("one of {}", fmt::join(names, ", ")));
}

bool JsonReader::has(JsonKey key) const { return find(key) != nullptr; }

bool JsonReader::is_null(JsonKey key) const { return value(key).is_null(); }

std::optional<JsonReader> JsonReader::optional_object(JsonKey key) const {
  if (!has(key)) return std::nullopt;
  return object(key);
}

std::optional<JsonReader> JsonReader::optional_array(JsonKey key, JsonLength length) const {
  if (!has(key)) return std::nullopt;
  return array(key, length);
}

std::optional<std::string> JsonReader::optional_text(JsonKey key, JsonLength bytes) const {
  return has(key) ? std::optional(text(key, bytes)) : std::nullopt;
}

std::optional<double> JsonReader::optional_number(JsonKey key, double least, double most) const {
  return has(key) ? std::optional(number(key, least, most)) : std::nullopt;
}

std::optional<bool> JsonReader::optional_boolean(JsonKey key) const {
  return has(key) ? std::optional(boolean(key)) : std::nullopt;
}

std::optional<UtcTime> JsonReader::optional_time(JsonKey key) const {
  return has(key) ? std::optional(time(key)) : std::nullopt;
}

std::size_t JsonReader::size() const { return value_->size(); }

std::vector<std::string> JsonReader::keys() const {
  std::vector<std::string> keys;
  if (!value_->is_object()) return keys;
  for (auto member = value_->begin(); member != value_->end(); ++member) {
    keys.push_back(member.key());
    read_.push_back(&*member);
  }
  return keys;
}

void JsonReader::finish(std::string_view ignored_prefix) const {
  if (!value_->is_object()) return;
  for (auto member = value_->begin(); member != value_->end(); ++member) {
    const bool ignored = !ignored_prefix.empty() && member.key().starts_with(ignored_prefix);
    if (ignored || std::find(read_.begin(), read_.end(), &*member) != read_.end()) continue;
    refuse_at(pointer_, "only members that this version knows", quote_json(member.key()));
  }
}

}  // namespace nadir
