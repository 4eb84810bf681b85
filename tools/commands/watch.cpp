// nadir watch: the state of a running nadird on a terminal: live, once, or as lines for a log.
#include <unistd.h>

#include <filesystem>
#include <optional>
#include <string>

#include "cli/command.hpp"
#include "cli/options.hpp"
#include "commands/commands.hpp"
#include "nadird_client/nadird_client.hpp"
#include "nadird_client/watch.hpp"
#include "trust/bearer_token.hpp"

namespace nadir {
namespace {

class WatchCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "watch"; }
  std::string_view summary() const override { return "monitor a running nadird"; }
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
  return R"(State, position, σ, anchor age, rates and the latest events. On a terminal the screen refreshes
until Ctrl-C; otherwise a line is written at each interval and for each event. If the service stops
responding, the command waits for it.

Exit codes: 0 shown, 1 with --once: there is no position now, or the flight thread does not respond,
2 the service does not answer.)";
}

std::string_view WatchCommand::examples() const {
  return R"(nadir watch
nadir watch http://10.0.0.7:8750 --token-file token
nadir watch --once --json)";
}

void WatchCommand::setup(Options& options) {
  options.positional("URL", url_, "address of nadird");
  options.value("--token-file", token_file_, "FILE", "bearer token of a service that listens beyond loopback");
  options.flag("--once", once_, "show the state once and exit");
  options.value("--interval-s", interval_s_, "S", "time between updates").between(0.1, 3600).formerly("--interval");
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
