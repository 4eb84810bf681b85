// What the sync commands get from outside beside the context: time that passes, randomness, the network, and a hook at
// every transition. The program takes the real ones; tests that kill and hurry take others.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string_view>
#include <utility>

#include "cli/command.hpp"
#include "upload/outbox.hpp"
#include "upload/transport.hpp"
#include "upload/uploader.hpp"

namespace nadir {

struct SyncEnvironment {
  std::function<std::unique_ptr<UploadClock>()> pace = [] { return std::make_unique<SystemUploadClock>(); };
  std::function<std::array<std::uint8_t, 16>()> random_bytes = system_random_bytes;
  TransitionHook hook{};
  // Wraps the real transport.
  std::function<std::unique_ptr<HttpTransport>(std::unique_ptr<HttpTransport>)> transport =
      [](std::unique_ptr<HttpTransport> real) { return real; };

  static std::array<std::uint8_t, 16> system_random_bytes();  // from the operating system
};

// A command that changes an outbox.
class SyncCommand : public Command {
 public:
  explicit SyncCommand(SyncEnvironment environment) : environment_(std::move(environment)) {}
  std::string_view group() const override { return "sync"; }
  bool offers_json() const override { return true; }

 protected:
  SyncEnvironment environment_;
  std::filesystem::path outbox_;
};

std::unique_ptr<Command> make_sync_stage(SyncEnvironment environment);
std::unique_ptr<Command> make_sync_push(SyncEnvironment environment);
std::unique_ptr<Command> make_sync_retry(SyncEnvironment environment);
std::unique_ptr<Command> make_sync_prune(SyncEnvironment environment);

}  // namespace nadir
