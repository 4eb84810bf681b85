// Declares a command's options without showing the parser behind them (CLI11 costs 6 s per file that includes it).
//
//   options.value("--out", out_, "PACKAGE", "folder that is made").required();
//   options.values("--imagery", imagery_, "FILE", "one or more rasters").required();
//   options.value("--quality", quality_, "N", "JPEG quality").between(1, 100);   // the member's value is the default
//   options.flag("--force", force_, "…");
//   options.positional("MISSION.yaml", mission_, "the mission").required();
//
// Types: std::string, std::filesystem::path, int, std::int64_t, std::uint64_t, double, LonLat ("LON,LAT"), UtcTime and
// std::optional of each; values() takes std::vector of each. A value that does not read is a UsageError naming the
// option.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/time.hpp"
#include "geodesy/lon_lat.hpp"

namespace nadir {

namespace option_text {
// Each reads `text` into `value`; false when it does not have the type's form.
bool read(const std::string& text, std::string& value);
bool read(const std::string& text, std::filesystem::path& value);
bool read(const std::string& text, int& value);
bool read(const std::string& text, std::int64_t& value);
bool read(const std::string& text, std::uint64_t& value);
bool read(const std::string& text, double& value);
bool read(const std::string& text, LonLat& value);
bool read(const std::string& text, UtcTime& value);

// What the type's form is, for messages: "a whole number".
const char* form(const std::string&);
const char* form(const std::filesystem::path&);
const char* form(int);
const char* form(std::int64_t);
const char* form(std::uint64_t);
const char* form(double);
const char* form(LonLat);
const char* form(UtcTime);

// The default as --help shows it; empty shows none.
std::string show(const std::string& value);
std::string show(const std::filesystem::path& value);
std::string show(int value);
std::string show(std::int64_t value);
std::string show(std::uint64_t value);
std::string show(double value);
std::string show(LonLat value);
std::string show(UtcTime value);
}  // namespace option_text

// A declared option, to say more about it.
class Option {
 public:
  Option& required();
  Option& between(double low, double high);                         // inclusive
  Option& one_of(std::initializer_list<std::string_view> choices);  // exact words
  Option& needs(std::string_view other);                            // another option that must be there as well

  struct State;
  explicit Option(State& state) : state_(&state) {}

 private:
  State* state_;
};

class Options {
 public:
  struct Impl;
  explicit Options(Impl& impl) : impl_(&impl) {}

  template <typename T>
  Option value(std::string_view name, T& target, std::string_view placeholder, std::string_view help) {
    return add(name, placeholder, help, option_text::show(target), option_text::form(target), false,
               [&target](const std::string& text) { return option_text::read(text, target); });
  }
  template <typename T>
  Option value(std::string_view name, std::optional<T>& target, std::string_view placeholder, std::string_view help) {
    return add(name, placeholder, help, {}, option_text::form(T{}), false, [&target](const std::string& text) {
      T value{};
      if (!option_text::read(text, value)) return false;
      target = std::move(value);
      return true;
    });
  }
  template <typename T>
  Option values(std::string_view name, std::vector<T>& target, std::string_view placeholder, std::string_view help) {
    return add(name, placeholder, help, {}, option_text::form(T{}), true, [&target](const std::string& text) {
      T value{};
      if (!option_text::read(text, value)) return false;
      target.push_back(std::move(value));
      return true;
    });
  }
  Option flag(std::string_view name, bool& target, std::string_view help);

  // An argument without a name. Positionals are taken in the order in which they are declared.
  template <typename T>
  Option positional(std::string_view placeholder, T& target, std::string_view help) {
    return value(placeholder, target, placeholder, help);
  }

 private:
  using Reader = std::function<bool(const std::string&)>;
  Option add(std::string_view name, std::string_view placeholder, std::string_view help, std::string shown_default,
             std::string form, bool many, Reader read);

  Impl* impl_;
};

}  // namespace nadir
