#include "cli/options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "cli/options_impl.hpp"

namespace nadir {
namespace option_text {
namespace {

template <typename Number>
bool read_number(std::string_view text, Number& value) {
  const char* end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, value);
  return result.ec == std::errc() && result.ptr == end;
}

}  // namespace

bool read(const std::string& text, std::string& value) { return value = text, !text.empty(); }
bool read(const std::string& text, std::filesystem::path& value) { return value = text, !text.empty(); }
bool read(const std::string& text, int& value) { return read_number(text, value); }
bool read(const std::string& text, std::int64_t& value) { return read_number(text, value); }
bool read(const std::string& text, std::uint64_t& value) { return read_number(text, value); }
bool read(const std::string& text, double& value) { return read_number(text, value) && std::isfinite(value); }

bool read(const std::string& text, LonLat& value) {
  const auto comma = text.find(',');
  if (comma == std::string::npos) return false;
  return read(text.substr(0, comma), value.lon_deg) && read(text.substr(comma + 1), value.lat_deg) &&
         std::abs(value.lon_deg) <= 180 && std::abs(value.lat_deg) <= 90;
}

bool read(const std::string& text, UtcTime& value) {
  const auto time = parse_utc(text);
  if (time) value = *time;
  return time.has_value();
}

const char* form(const std::string&) { return "text"; }
const char* form(const std::filesystem::path&) { return "a path"; }
const char* form(int) { return "a whole number"; }
const char* form(std::int64_t) { return "a whole number"; }
const char* form(std::uint64_t) { return "a whole number that is not negative"; }
const char* form(double) { return "a number"; }
const char* form(LonLat) { return "longitude,latitude in degrees, for example 120.72,24.26"; }
const char* form(UtcTime) { return "a date (2024-10-30) or an RFC 3339 time (2024-10-30T12:00:00Z)"; }

std::string show(const std::string& value) { return value; }
std::string show(const std::filesystem::path& value) { return value.string(); }
std::string show(int value) { return fmt::format("{}", value); }
std::string show(std::int64_t value) { return fmt::format("{}", value); }
std::string show(std::uint64_t value) { return fmt::format("{}", value); }
std::string show(double value) { return fmt::format("{}", value); }
std::string show(LonLat) { return {}; }
std::string show(UtcTime) { return {}; }

}  // namespace option_text

Option& Option::required() {
  state_->required = true;
  state_->shown_default.clear();
  return *this;
}

Option& Option::between(double low, double high) {
  state_->ranges.emplace_back(low, high);
  return *this;
}

Option& Option::one_of(std::initializer_list<std::string_view> choices) {
  state_->choices.assign(choices.begin(), choices.end());
  return *this;
}

Option& Option::needs(std::string_view other) {
  state_->needs.emplace_back(other);
  return *this;
}

Option Options::flag(std::string_view name, bool& target, std::string_view help) {
  Option option = add(name, {}, help, {}, {}, false, [&target](const std::string&) { return target = true; });
  impl_->options.back().takes_value = false;
  return option;
}

Option Options::add(std::string_view name, std::string_view placeholder, std::string_view help,
                    std::string shown_default, std::string form, bool many, Reader read) {
  Option::State& state = impl_->options.emplace_back();
  state.name = name;
  state.placeholder = placeholder;
  state.help = help;
  state.shown_default = std::move(shown_default);
  state.form = std::move(form);
  state.many = many;
  state.read = std::move(read);
  return Option(state);
}

std::string nearest_word(const std::string& typed, const std::vector<std::string>& known) {
  // Levenshtein distance; a suggestion must share more than it differs in.
  const auto distance = [](const std::string& a, const std::string& b) {
    std::vector<std::size_t> row(b.size() + 1);
    for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
    for (std::size_t i = 1; i <= a.size(); ++i) {
      std::size_t diagonal = row[0]++;
      for (std::size_t j = 1; j <= b.size(); ++j) {
        const std::size_t above = row[j];
        row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0U : 1U)});
        diagonal = above;
      }
    }
    return row[b.size()];
  };
  std::string best;
  std::size_t best_distance = std::max<std::size_t>(2, typed.size() / 3) + 1;
  for (const std::string& word : known) {
    const std::size_t d = word.starts_with(typed) && typed.size() >= 3 ? 1 : distance(typed, word);
    if (d < best_distance) best_distance = d, best = word;
  }
  return best;
}

}  // namespace nadir
