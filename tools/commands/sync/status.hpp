// nadir sync status: what is in the outbox and what keeps it.
#pragma once

#include <filesystem>

#include "cli/command.hpp"

namespace nadir {

class SyncStatusCommand final : public Command {
 public:
  std::string_view group() const override { return "sync"; }
  std::string_view name() const override { return "status"; }
  std::string_view summary() const override { return "show what is in the outbox and what keeps it"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path outbox_;
  int failed_ = 0;
};

}  // namespace nadir
