// Reading YAML written by people: every value knows its file, line and column, so that a message can point at it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nadir {

class YamlNode {
 public:
  // Throw UsageError for what is no YAML (with line and column), has duplicate keys, aliases, more than 32 levels or
  // 200000 values, or is larger than 1 MiB.
  static YamlNode read(const std::filesystem::path& path);
  static YamlNode parse(std::string_view text, std::string_view name);

  YamlNode required(std::string_view key) const;
  std::optional<YamlNode> optional(std::string_view key) const;
  // Throws UsageError naming the first key that is not in the list: a misspelt key must not be ignored.
  void allow_only(std::initializer_list<std::string_view> keys) const;

  std::vector<YamlNode> items() const;  // of a sequence
  std::string text() const;
  double number() const;  // finite
  std::int64_t integer() const;
  bool is_map() const;
  bool is_sequence() const;
  bool is_scalar() const;

  std::string where() const;  // "mission.yaml:12:3 (zoom.min)"

  // Throws the UsageError that this node is not what was expected.
  [[noreturn]] void reject(std::string_view expected) const;

 private:
  struct Place;
  explicit YamlNode(std::shared_ptr<const Place> place) : place_(std::move(place)) {}
  std::shared_ptr<const Place> place_;
};

}  // namespace nadir
