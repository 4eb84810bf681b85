// nadir watch: what a running nadird says, on a terminal: live, once, or as lines for a log.
#include <unistd.h>

#include <filesystem>
#include <optional>
#include <string>

#include "cli/command.hpp"
#include "cli/options.hpp"
#include "commands/commands.hpp"
#include "nadird_client/nadird_client.hpp"
#include "nadird_client/watching.hpp"
#include "trust/bearer_token.hpp"

namespace nadir {
namespace {

class WatchCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "watch"; }
  std::string_view summary() const override { return "show what a running nadird says"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string url_{kDefaultServiceUrl};
  std::optional<std::filesystem::path> token_file_;
  bool once_ = false;
  double interval_s_ = 1;
};

std::string_view WatchCommand::details() const {
  return "State, position, σ, anchor age, rates and the last events. On a terminal the screen renews itself until "
         "Ctrl-C; "
         "otherwise\na line is written at each interval and for each event. A service that falls silent is waited "
         "for.\n\n"
         "Exit codes: 0 shown, 1 with --once: there is no position now, or the flight's thread is silent, 2 the "
         "service "
         "does not answer.";
}

std::string_view WatchCommand::examples() const {
  return "nadir watch\nnadir watch http://10.0.0.7:8750 --token-file token\nnadir watch --once --json";
}

void WatchCommand::setup(Options& options) {
  options.positional("URL", url_, "where nadird listens");
  options.value("--token-file", token_file_, "FILE", "the token of a service that listens beyond loopback");
  options.flag("--once", once_, "show it once and end");
  options.value("--interval", interval_s_, "S", "seconds between two looks").between(0.1, 3600);
}

int WatchCommand::run(Context& context) {
  const NadirdClient service(url_, token_file_ ? read_bearer_token(*token_file_) : std::string());
  if (once_) return show_once(service, context.out, context.json);
  const bool screen = !context.json && ::isatty(STDOUT_FILENO) == 1;
  const WatchForm form = context.json ? WatchForm::json : screen ? WatchForm::screen : WatchForm::lines;
  keep_showing(service, context.out, form, interval_s_);
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_watch() { return std::make_unique<WatchCommand>(); }

}  // namespace nadir
