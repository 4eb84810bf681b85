// `nadir sync` as it is, but for three things that the environment asks for: it kills itself (SIGKILL, nothing is
// tidied up) at a named point or at the N-th point of its way, it does not wait in real time, and its randomness is
// seeded.
//   NADIR_TEST_KILL_AT=announce:before | announce:after | request:PATCH | reply:PATCH …
//   NADIR_TEST_KILL_COUNT=N       with KILL_AT: the N-th time there; alone: the N-th point of all
//   NADIR_TEST_SEED=N
#include <csignal>
#include <cstdlib>
#include <iostream>
#include <random>

#include "cli/program.hpp"
#include "cli/terminal.hpp"
#include "commands/commands.hpp"
#include "commands/sync/sync_environment.hpp"

namespace nadir {
namespace {

std::string environment(const char* name, const char* otherwise) {
  const char* text = std::getenv(name);
  return text != nullptr ? text : otherwise;
}

class Killer {
 public:
  void at(const std::string& point) {
    if (!point_.empty() && point != point_) return;
    if (count_ <= 0 || --count_ > 0) return;
    std::cerr << "killed at " << point << std::endl;
    std::raise(SIGKILL);
  }

 private:
  std::string point_ = environment("NADIR_TEST_KILL_AT", "");
  int count_ = std::atoi(environment("NADIR_TEST_KILL_COUNT", point_.empty() ? "0" : "1").c_str());
};

// Time goes on by what was to be waited.
class HurriedClock final : public UploadClock {
 public:
  std::int64_t now_ms() const override { return SystemUploadClock().now_ms() + skipped_ms_; }
  void wait(std::int64_t duration_ms, const std::function<void()>& check) override {
    check();
    skipped_ms_ += duration_ms;
  }

 private:
  std::int64_t skipped_ms_ = 0;
};

class WatchedTransport final : public HttpTransport {
 public:
  WatchedTransport(std::unique_ptr<HttpTransport> real, Killer& killer) : real_(std::move(real)), killer_(killer) {}

  HttpResult exchange(const HttpRequest& request) override {
    killer_.at("request:" + request.method);
    HttpResult result = real_->exchange(request);
    killer_.at("reply:" + request.method);
    return result;
  }

 private:
  std::unique_ptr<HttpTransport> real_;
  Killer& killer_;
};

int run(const std::vector<std::string>& args) {
  Killer killer;
  std::mt19937_64 engine(static_cast<std::uint64_t>(std::atoll(environment("NADIR_TEST_SEED", "1").c_str())));
  SyncEnvironment around;
  around.pace = [] { return std::make_unique<HurriedClock>(); };
  around.random_bytes = [&engine] {
    std::array<std::uint8_t, 16> bytes{};
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(engine());
    return bytes;
  };
  around.hook = [&killer](std::string_view transition, bool committed) {
    killer.at(std::string(transition) + (committed ? ":after" : ":before"));
  };
  around.transport = [&killer](std::unique_ptr<HttpTransport> real) {
    return std::make_unique<WatchedTransport>(std::move(real), killer);
  };
  std::vector<std::unique_ptr<Command>> commands;
  commands.push_back(make_sync_stage(around));
  commands.push_back(make_sync_push(around));
  commands.push_back(make_sync_status());
  commands.push_back(make_sync_retry(around));
  commands.push_back(make_sync_prune(around));
  const SystemClock clock;
  return run_program({"killed_sync", "nadir sync with a death wish", ""}, commands, args,
                     {std::cout, std::cerr, clock, ProgressStyle::none, 80});
}

}  // namespace
}  // namespace nadir

int main(int argc, char** argv) {
  nadir::install_signal_handlers();
  return nadir::run({argv + 1, argv + argc});
}
