// The declared options of one command, between their declaration and the parser.
#pragma once

#include <functional>
#include <list>
#include <string>
#include <utility>
#include <vector>

#include "cli/options.hpp"

namespace nadir {

struct Option::State {
  std::string name;  // "--out", or "PACKAGE" for a positional
  std::string placeholder;
  std::string help;
  std::string shown_default;
  std::string form;
  bool many = false;
  bool takes_value = true;
  bool required = false;
  std::vector<std::pair<double, double>> ranges;
  std::vector<std::string> choices;
  std::vector<std::string> needs;
  std::function<bool(const std::string&)> read;
  std::vector<std::string> given;  // as typed
  bool present = false;

  bool positional() const { return !name.starts_with('-'); }
};

struct Options::Impl {
  std::list<Option::State> options;  // a list, because Option keeps a pointer
};

struct ParseOutcome {
  bool help = false;
};

// Parses and stores the values. Throws UsageError; `command` ("nadir cache build") names the help page in messages.
ParseOutcome parse_options(Options::Impl& options, const std::string& command, const std::vector<std::string>& args);

// The known word that was probably meant, or nothing.
std::string nearest_word(const std::string& typed, const std::vector<std::string>& known);

}  // namespace nadir
