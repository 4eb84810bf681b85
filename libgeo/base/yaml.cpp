#include "base/yaml.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <sstream>
#include <unordered_set>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/number_text.hpp"

namespace nadir {

struct YamlNode::Place {
  YAML::Node node;
  std::string file;
  std::string path;  // "zoom.min"

  std::string where() const {
    const YAML::Mark mark = node.Mark();
    std::string text = file;
    if (!mark.is_null()) text += fmt::format(":{}:{}", mark.line + 1, mark.column + 1);
    if (!path.empty()) text += " (" + path + ")";
    return text;
  }
  std::string description() const {
    if (node.IsMap()) return "a mapping";
    if (node.IsSequence()) return "a list";
    if (node.IsScalar()) return "\"" + node.Scalar().substr(0, 80) + "\"";
    return "nothing";
  }
};

namespace {

constexpr std::uint64_t kMaxYamlSize = std::uint64_t{1} << 20;
constexpr std::size_t kMaxValues = 200'000;  // scalars, lists and mappings: some 400 bytes of memory each
constexpr std::size_t kMaxQuotedKey = 80;    // bytes of a key in a message

// Rejects what can hide a value from a reader or blow up a small file: aliases, duplicate keys, deep nesting, myriads
// of empty values.
class YamlGuard final : public YAML::EventHandler {
 public:
  explicit YamlGuard(std::string file) : file_(std::move(file)) {}

  void OnDocumentStart(const YAML::Mark& mark) override {
    if (++documents_ > 1) fail(mark, "a second document (---)", "one document");
  }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t) override { count(mark), value(); }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t) override { fail(mark, "an alias (*name)", "plain values"); }
  void OnScalar(const YAML::Mark& mark, const std::string&, YAML::anchor_t, const std::string& scalar) override {
    if (!levels_.empty() && levels_.back().is_map && levels_.back().expects_key) {
      if (!levels_.back().keys.insert(scalar).second) {
        fail(mark, "the key \"" + scalar.substr(0, kMaxQuotedKey) + "\" a second time", "each key once");
      }
    }
    count(mark);
    value();
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t, YAML::EmitterStyle::value) override {
    enter(mark, false);
  }
  void OnSequenceEnd() override { levels_.pop_back(), value(); }
  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t, YAML::EmitterStyle::value) override {
    enter(mark, true);
  }
  void OnMapEnd() override { levels_.pop_back(), value(); }

 private:
  int documents_ = 0;
  std::size_t values_ = 0;

  struct Level {
    bool is_map;
    bool expects_key = true;
    std::unordered_set<std::string> keys{};
  };

  void enter(const YAML::Mark& mark, bool is_map) {
    if (levels_.size() >= 32) fail(mark, "more than 32 levels of nesting", "a flat document");
    count(mark);
    levels_.push_back({is_map});
  }
  void count(const YAML::Mark& mark) {
    if (++values_ > kMaxValues) fail(mark, fmt::format("more than {} values", kMaxValues), "a smaller document");
  }
  void value() {
    if (!levels_.empty()) levels_.back().expects_key = !levels_.back().expects_key;
  }
  [[noreturn]] void fail(const YAML::Mark& mark, std::string found, std::string expected) const {
    throw UsageError({.what = "this YAML is not accepted",
                      .where = fmt::format("{}:{}:{}", file_, mark.line + 1, mark.column + 1),
                      .expected = std::move(expected),
                      .found = std::move(found)});
  }

  std::string file_;
  std::vector<Level> levels_;
};

}  // namespace

YamlNode YamlNode::read(const std::filesystem::path& path) {
  return parse(read_text_file(path, kMaxYamlSize), path.string());
}

YamlNode YamlNode::parse(std::string_view text, std::string_view name) {
  if (text.size() > kMaxYamlSize) {
    throw UsageError({.what = "the YAML file is too large",
                      .where = std::string(name),
                      .expected = fmt::format("at most {} bytes", kMaxYamlSize),
                      .found = fmt::format("{} bytes", text.size())});
  }
  try {
    std::istringstream events{std::string(text)};
    YamlGuard guard{std::string(name)};
    YAML::Parser parser(events);
    while (parser.HandleNextDocument(guard)) {
    }
    auto place = std::make_shared<Place>();
    place->node = YAML::Load(std::string(text));
    place->file = name;
    return YamlNode(std::move(place));
  } catch (const YAML::Exception& error) {
    throw UsageError({.what = "cannot read YAML",
                      .where = fmt::format("{}:{}:{}", name, error.mark.line + 1, error.mark.column + 1),
                      .found = error.msg});
  }
}

std::optional<YamlNode> YamlNode::optional(std::string_view key) const {
  if (!is_map()) reject("a mapping");
  const YAML::Node child = place_->node[std::string(key)];
  if (!child.IsDefined()) return std::nullopt;
  auto place = std::make_shared<Place>();
  place->node = child;
  place->file = place_->file;
  place->path = place_->path.empty() ? std::string(key) : place_->path + "." + std::string(key);
  return YamlNode(std::move(place));
}

YamlNode YamlNode::required(std::string_view key) const {
  if (auto child = optional(key)) return *child;
  throw UsageError({.what = "a value is missing", .where = where(), .expected = fmt::format("a key \"{}\"", key)});
}

void YamlNode::allow_only(std::initializer_list<std::string_view> keys) const {
  if (!is_map()) reject("a mapping");
  for (const auto& entry : place_->node) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "?";
    if (std::find(keys.begin(), keys.end(), key) != keys.end()) continue;
    throw UsageError(
        {.what = "unknown key",
         .where = fmt::format("{}:{}:{}", place_->file, entry.first.Mark().line + 1, entry.first.Mark().column + 1),
         .expected = fmt::format("one of: {}", fmt::join(keys, ", ")),
         .found = fmt::format("\"{}\"", key)});
  }
}

std::vector<YamlNode> YamlNode::items() const {
  if (!is_sequence()) reject("a list");
  std::vector<YamlNode> nodes;
  for (std::size_t i = 0; i < place_->node.size(); ++i) {
    auto place = std::make_shared<Place>();
    place->node = place_->node[i];
    place->file = place_->file;
    place->path = fmt::format("{}[{}]", place_->path, i);
    nodes.push_back(YamlNode(std::move(place)));
  }
  return nodes;
}

std::string YamlNode::text() const {
  if (!is_scalar()) reject("a text");
  return place_->node.Scalar();
}

double YamlNode::number() const {
  if (!is_scalar()) reject("a number");
  const auto value = finite_number(place_->node.Scalar());
  if (!value) reject("a finite number");
  return *value;
}

std::int64_t YamlNode::integer() const {
  if (!is_scalar()) reject("an integer");
  const auto value = whole_number<std::int64_t>(place_->node.Scalar());
  if (!value) reject("an integer");
  return *value;
}

bool YamlNode::is_map() const { return place_->node.IsMap(); }
bool YamlNode::is_sequence() const { return place_->node.IsSequence(); }
bool YamlNode::is_scalar() const { return place_->node.IsScalar(); }
std::string YamlNode::where() const { return place_->where(); }

void YamlNode::reject(std::string_view expected) const {
  throw UsageError({.what = "a value has the wrong form",
                    .where = where(),
                    .expected = std::string(expected),
                    .found = place_->description()});
}

}  // namespace nadir
