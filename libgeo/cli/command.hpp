// One command of a program: its name, its options and its work.
//
// A command is set up (its options declared, nothing opened), parsed, and then run once. run() returns kAccepted or
// kRefused; whatever else happens is an exception (base/error.hpp) that program.cpp turns into a message and an exit
// code.
#pragma once

#include <iosfwd>
#include <memory>
#include <string_view>

#include "base/progress.hpp"
#include "base/time.hpp"

namespace nadir {

class Options;

// Exit codes of every command (docs/commands/index.md).
inline constexpr int kAccepted = 0;  // success
inline constexpr int kRefused = 1;   // a check failed; the findings say why
inline constexpr int kFailed = 2;    // wrong usage, or the job could not be done
inline constexpr int kInterrupted = 130;

// What a command gets from outside.
struct Context {
  std::ostream& out;   // results
  std::ostream& err;   // progress and messages
  const Clock& clock;  // the present time; commands with --at prefer that
  Progress& progress;  // advance() throws Interrupted after Ctrl-C, in the thread that called begin()
  bool json = false;   // the result is wanted as JSON
  bool quiet = false;  // no messages but errors
};

class Command {
 public:
  virtual ~Command() = default;

  virtual std::string_view group() const = 0;               // "cache"; empty for a command without a group ("replay")
  virtual std::string_view name() const = 0;                // "build"
  virtual std::string_view summary() const = 0;             // one line, lower case, no full stop
  virtual std::string_view details() const { return {}; }   // for --help: laid out as it is read
  virtual std::string_view examples() const { return {}; }  // for --help: commands, one per line
  virtual bool offers_json() const { return false; }

  virtual void setup(Options& options) = 0;
  virtual int run(Context& context) = 0;
};

}  // namespace nadir
