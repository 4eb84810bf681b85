#include "cli/options.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <list>
#include <ostream>

#include "base/error.hpp"
#include "base/number_text.hpp"
#include "cli/help_text.hpp"
#include "geodesy/mgrs.hpp"

namespace nadir {
namespace option_text {
namespace {

template <typename Value>
bool take(const std::optional<Value>& read, Value& value) {
  if (read) value = *read;
  return read.has_value();
}

}  // namespace

bool read(const std::string& text, std::string& value) { return value = text, !text.empty(); }
bool read(const std::string& text, std::filesystem::path& value) { return value = text, !text.empty(); }
bool read(const std::string& text, int& value) { return take(whole_number<int>(text), value); }
bool read(const std::string& text, std::int64_t& value) { return take(whole_number<std::int64_t>(text), value); }
bool read(const std::string& text, std::uint64_t& value) { return take(whole_number<std::uint64_t>(text), value); }
bool read(const std::string& text, double& value) { return take(finite_number(text), value); }

bool read(const std::string& text, LonLat& value) {
  const auto comma = text.find(',');
  if (comma == std::string::npos) return take(lonlat_from_mgrs(text), value);
  return read(text.substr(0, comma), value.lon_deg) && read(text.substr(comma + 1), value.lat_deg) &&
         std::abs(value.lon_deg) <= 180 && std::abs(value.lat_deg) <= 90;
}

bool read(const std::string& text, UtcTime& value) { return take(parse_utc(text), value); }

const char* form(const std::string&) { return "text"; }
const char* form(const std::filesystem::path&) { return "a path"; }
const char* form(int) { return "a whole number"; }
const char* form(std::int64_t) { return "a whole number"; }
const char* form(std::uint64_t) { return "a whole number that is not negative"; }
const char* form(double) { return "a number"; }
const char* form(LonLat) {
  return "longitude,latitude in degrees (120.72,24.26), or an MGRS reference of a square of 1 km or less "
         "(18SUJ2282106997)";
}
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

namespace {

void print_examples(std::ostream& out, std::string_view examples) {
  if (examples.empty()) return;
  out << "\nExamples:\n";
  while (!examples.empty()) {
    const std::size_t end = std::min(examples.find('\n'), examples.size());
    out << "  " << examples.substr(0, end) << '\n';
    examples.remove_prefix(std::min(end + 1, examples.size()));
  }
}

}  // namespace

struct Option::State {
  CLI::Option* option;
  Options::Impl* owner;
  bool free_text = false;
  std::vector<std::string> choices{};
};

struct Options::Impl {
  CLI::App app;
  std::string command;
  std::list<Option::State> states;                             // a list, because Option keeps a pointer
  std::vector<std::pair<CLI::Option*, std::string>> needs;     // the other one may be declared later
  std::vector<std::pair<std::string, std::string>> old_names;  // with what they are called now
  std::vector<std::vector<std::string>> alternatives;          // each the mode and what goes with it

  std::string hint() const { return fmt::format("`{} --help` lists the options", command); }

  // "--out PACKAGE", "MISSION.yaml", "--force"
  static std::string title(const CLI::Option& option) {
    std::string title = option.get_name();
    if (!option.get_positional() && option.get_type_size() != 0) title += " " + option.get_type_name();
    return title;
  }

  std::vector<std::string> with_present_names(const std::vector<std::string>& args) const;
  void choose_alternative(const std::vector<std::string>& args);
  [[noreturn]] void reject(const CLI::ParseError& error) const;
};

Option& Option::required() {
  state_->option->required()->default_str("");
  return *this;
}

Option& Option::between(double low, double high) {
  state_->option->check(CLI::Validator(
      [low, high](const std::string& text) {
        const double number = std::strtod(text.c_str(), nullptr);
        if (number >= low && number <= high) return std::string();
        return fmt::format("{} is not in the range {} to {}", text, low, high);
      },
      ""));
  return *this;
}

Option& Option::one_of(std::initializer_list<std::string_view> choices) {
  const std::vector<std::string> words(choices.begin(), choices.end());
  state_->option->check(CLI::Validator(
      [words](const std::string& text) {
        if (std::find(words.begin(), words.end(), text) != words.end()) return std::string();
        return fmt::format("\"{}\" is not one of {}", text, fmt::join(words, ", "));
      },
      ""));
  state_->choices = words;
  state_->option->description(fmt::format("{} ({})", state_->option->get_description(), fmt::join(words, ", ")));
  return *this;
}

Option& Option::needs(std::string_view other) {
  state_->owner->needs.emplace_back(state_->option, other);
  return *this;
}

Option& Option::formerly(std::string_view old_name) {
  state_->owner->old_names.emplace_back(old_name, state_->option->get_name());
  return *this;
}

Options::Options(std::string command) : impl_(std::make_unique<Impl>()) {
  impl_->command = std::move(command);
  impl_->app.set_help_flag();
}
Options::~Options() = default;

Option Options::flag(std::string_view name, bool& target, std::string_view help) {
  CLI::Option* option = impl_->app.add_flag_callback(
      std::string(name), [&target] { target = true; }, std::string(help));
  return Option(impl_->states.emplace_back(Option::State{option, impl_.get()}));
}

Option Options::add(const Declaration& declared, Reader read) {
  const std::string name(declared.name), form(declared.form);
  const auto store = [name, form, read = std::move(read)](const std::vector<std::string>& texts) {
    for (const std::string& text : texts) {
      if (!read(text)) throw CLI::ValidationError(name, fmt::format("expected {}, found \"{}\"", form, text));
    }
    return true;
  };
  CLI::Option* option = impl_->app.add_option(name, store, std::string(declared.help));
  option->type_name(std::string(declared.placeholder))->default_str(declared.shown_default);
  option->expected(1, declared.many ? CLI::detail::expected_max_vector_size : 1);
  option->allow_extra_args(declared.many);
  option->multi_option_policy(declared.many ? CLI::MultiOptionPolicy::TakeAll : CLI::MultiOptionPolicy::Throw);
  const bool free_text =
      declared.form == option_text::form(std::string()) || declared.form == option_text::form(std::filesystem::path());
  return Option(impl_->states.emplace_back(Option::State{option, impl_.get(), free_text}));
}

std::vector<std::string> Options::Impl::with_present_names(const std::vector<std::string>& args) const {
  std::vector<std::string> result;
  for (const std::string& arg : args) {
    const std::string typed = arg.substr(0, arg.find('='));
    const auto old =
        std::find_if(old_names.begin(), old_names.end(), [&](const auto& names) { return names.first == typed; });
    result.push_back(old == old_names.end() ? arg : old->second + arg.substr(typed.size()));
  }
  return result;
}

void Options::Impl::choose_alternative(const std::vector<std::string>& args) {
  const auto named = [&](const std::string& name) {
    return std::any_of(args.begin(), args.end(),
                       [&](const std::string& arg) { return arg.substr(0, arg.find('=')) == name; });
  };
  for (const std::vector<std::string>& words : alternatives) {
    if (!named(words.front())) continue;
    for (CLI::Option* option : app.get_options()) {
      const std::string name = option->get_name();
      option->required(false);
      if (!named(name) || std::find(words.begin(), words.end(), name) != words.end()) continue;
      throw UsageError({.what = fmt::format("{} cannot be given with {}", name, words.front()),
                        .expected = fmt::format("{} alone", fmt::join(words, ", ")),
                        .fix = hint()});
    }
  }
}

// CLI11's own words, with what helps: the placeholder of a missing option, and the option that was probably meant.
void Options::Impl::reject(const CLI::ParseError& error) const {
  if (!app.remaining().empty()) {
    const std::string extra = app.remaining().front();
    if (!extra.starts_with('-')) {
      throw UsageError({.what = fmt::format("unexpected argument \"{}\"", extra), .fix = hint()});
    }
    std::vector<std::string> known{"--help"};
    for (const CLI::Option* option : app.get_options()) {
      if (!option->get_positional()) known.push_back(option->get_name());
    }
    const std::string typed = extra.substr(0, extra.find('='));
    const std::string guess = nearest_word(typed, known);
    throw UsageError({.what = fmt::format("{} has no option {}", command, typed),
                      .fix = guess.empty() ? hint() : fmt::format("did you mean {}? {}", guess, hint())});
  }
  if (dynamic_cast<const CLI::RequiredError*>(&error) != nullptr) {
    for (const CLI::Option* option : app.get_options()) {
      if (!option->get_required() || option->count() > 0) continue;
      throw UsageError({.what = fmt::format("{} is required", title(*option)),
                        .expected = option->get_description(),
                        .fix = hint()});
    }
  }
  throw UsageError({.what = error.what(), .fix = hint()});
}

void Options::alternative(std::string_view mode, std::initializer_list<std::string_view> with) {
  std::vector<std::string>& words = impl_->alternatives.emplace_back();
  words.emplace_back(mode);
  words.insert(words.end(), with.begin(), with.end());
}

bool Options::parse(const std::vector<std::string>& args) {
  if (std::any_of(args.begin(), args.end(), [](const std::string& arg) { return arg == "--help" || arg == "-h"; })) {
    return false;
  }
  impl_->choose_alternative(impl_->with_present_names(args));
  for (const auto& [option, other] : impl_->needs) option->needs(impl_->app.get_option(other));
  std::vector<std::string> reversed = impl_->with_present_names(args);
  std::reverse(reversed.begin(), reversed.end());
  try {
    impl_->app.parse(std::move(reversed));
  } catch (const CLI::ParseError& error) {
    impl_->reject(error);
  }
  return true;
}

void print_entries(std::ostream& out, const std::vector<std::pair<std::string, std::string>>& entries) {
  std::size_t width = 0;
  for (const auto& [left, right] : entries) width = std::max(width, left.size());
  width = std::min<std::size_t>(width, 34);
  for (const auto& [left, right] : entries) {
    if (left.size() > width) {
      out << "  " << left << '\n' << std::string(width + 4, ' ');
    } else {
      out << "  " << left << std::string(width - left.size() + 2, ' ');
    }
    out << filled(right, width + 4) << '\n';
  }
}

std::string OptionDescription::title() const {
  const std::string named = positional || placeholder.empty() ? name : name + " " + placeholder;
  return named + (many ? "..." : "");
}

std::string OptionDescription::explanation() const {
  return shown_default.empty() ? help : fmt::format("{} [{}]", help, shown_default);
}

std::vector<OptionDescription> Options::described() const {
  std::vector<OptionDescription> result;
  for (const Option::State& state : impl_->states) {
    const CLI::Option& option = *state.option;
    result.push_back({.name = option.get_name(),
                      .placeholder = option.get_type_size() == 0 ? std::string() : option.get_type_name(),
                      .help = option.get_description(),
                      .shown_default = option.get_default_str(),
                      .choices = state.choices,
                      .positional = option.get_positional(),
                      .required = option.get_required(),
                      .many = option.get_allow_extra_args(),
                      .free_text = state.free_text && state.choices.empty()});
  }
  return result;
}

std::string usage_line(const std::string& command, const std::vector<OptionDescription>& options) {
  std::string usage = command;
  for (const OptionDescription& option : options) {
    if (option.required) {
      usage += " " + option.title();
    } else if (option.positional) {
      usage += " [" + option.title() + "]";
    }
  }
  return usage + " [OPTIONS]";
}

void Options::print_help(std::ostream& out, std::string_view summary, std::string_view details,
                         std::string_view examples) const {
  std::vector<std::pair<std::string, std::string>> arguments, required, optional;
  const std::vector<OptionDescription> options = described();
  for (const OptionDescription& option : options) {
    auto& section = option.positional ? arguments : option.required ? required : optional;
    section.emplace_back(option.title(), option.explanation());
  }
  optional.emplace_back("-h, --help", "show this help and exit");
  out << impl_->command << ": " << summary << "\n\nUsage: " << filled(usage_line(impl_->command, options), 7) << '\n';
  if (!details.empty()) out << '\n' << filled(details, 0) << '\n';
  const auto section = [&out](const char* title, const auto& entries) {
    if (entries.empty()) return;
    out << '\n' << title << ":\n";
    print_entries(out, entries);
  };
  section("Arguments", arguments);
  section("Required", required);
  section("Options", optional);
  print_examples(out, examples);
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
