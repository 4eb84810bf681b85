// A command's options: declared, parsed and shown by CLI11, which only options.cpp includes (it costs 6 s a file).
//
//   options.value("--out", out_, "PACKAGE", "folder that is made").required();
//   options.values("--imagery", imagery_, "FILE", "one or more rasters").required();
//   options.value("--quality", quality_, "N", "JPEG quality").between(1, 100);   // the member's value is the default
//   options.flag("--force", force_, "…");
//   options.positional("MISSION.yaml", mission_, "the mission").required();
//
// Types: std::string, std::filesystem::path, int, std::int64_t, std::uint64_t, double, LonLat ("LON,LAT"), UtcTime and
// std::optional of each; values() takes std::vector of each. A value that cannot be read is a UsageError that names
// the option.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <iosfwd>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
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
  Option& needs(std::string_view other);                            // another option that must be given as well
  // An older spelling that still works for one release; --help does not show it.
  Option& formerly(std::string_view old_name);

  struct State;
  explicit Option(State& state) : state_(&state) {}

 private:
  State* state_;
};

// What is known of a declared option: for --help, manual pages (manual_page.hpp) and completions (completions.hpp).
struct OptionDescription {
  std::string name;         // "--out"; the placeholder of a positional
  std::string placeholder;  // empty for a flag
  std::string help;         // with the choices, if there are any
  std::string shown_default;
  std::vector<std::string> choices;
  bool positional = false, required = false;
  bool many = false;       // several values may follow it
  bool free_text = false;  // a path or a text, which may name a file: not a number, a time or a place

  std::string title() const;        // "--out PACKAGE", "MISSION.yaml", "--imagery FILE..."
  std::string explanation() const;  // the help with the default
};

class Options {
 public:
  struct Impl;
  explicit Options(std::string command);  // "nadir cache build": names the help page in messages
  ~Options();

  // Parses and stores the values; false when --help was asked for, which wins over everything that is wrong. Throws
  // UsageError.
  bool parse(const std::vector<std::string>& args);

  // In the order of their declaration.
  std::vector<OptionDescription> described() const;

  // Arguments, required and optional options, in that order; lines of at most 100 columns.
  void print_help(std::ostream& out, std::string_view summary, std::string_view details,
                  std::string_view examples) const;

  template <typename T>
  Option value(std::string_view name, T& target, std::string_view placeholder, std::string_view help) {
    return add({.name = name,
                .placeholder = placeholder,
                .help = help,
                .shown_default = option_text::show(target),
                .form = option_text::form(target)},
               [&target](const std::string& text) { return option_text::read(text, target); });
  }
  template <typename T>
  Option value(std::string_view name, std::optional<T>& target, std::string_view placeholder, std::string_view help) {
    return add({.name = name, .placeholder = placeholder, .help = help, .form = option_text::form(T{})},
               [&target](const std::string& text) {
                 T value{};
                 if (!option_text::read(text, value)) return false;
                 target = std::move(value);
                 return true;
               });
  }
  template <typename T>
  Option values(std::string_view name, std::vector<T>& target, std::string_view placeholder, std::string_view help) {
    return add({.name = name, .placeholder = placeholder, .help = help, .form = option_text::form(T{}), .many = true},
               [&target](const std::string& text) {
                 T value{};
                 if (!option_text::read(text, value)) return false;
                 target.push_back(std::move(value));
                 return true;
               });
  }
  Option flag(std::string_view name, bool& target, std::string_view help);

  // Another way to call the command: with the option `mode`, only it and these may be given, and no other is required.
  // After they have been declared.
  void alternative(std::string_view mode, std::initializer_list<std::string_view> with);

  // An argument without a name. Positionals are taken in the order in which they are declared.
  template <typename T>
  Option positional(std::string_view placeholder, T& target, std::string_view help) {
    return value(placeholder, target, placeholder, help);
  }

 private:
  struct Declaration {
    std::string_view name, placeholder, help;
    std::string shown_default{};
    std::string_view form{};  // what a value looks like, for messages
    bool many = false;
  };
  using Reader = std::function<bool(const std::string&)>;
  Option add(const Declaration& declared, Reader read);

  std::unique_ptr<Impl> impl_;
};

// The known word that was probably meant, or nothing.
std::string nearest_word(const std::string& typed, const std::vector<std::string>& known);

// "nadir cache build PACKAGE --out FILE [OPTIONS]": arguments, and the options that are required.
std::string usage_line(const std::string& command, const std::vector<OptionDescription>& options);

// Two columns; the right one is wrapped at 100 columns of the line.
void print_entries(std::ostream& out, const std::vector<std::pair<std::string, std::string>>& entries);

}  // namespace nadir
