// nadir keys create: a new Ed25519 key pair as two PEM files.
#pragma once

#include <filesystem>

#include "cli/command.hpp"

namespace nadir {

class KeysCreateCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "create"; }
  std::string_view summary() const override { return "make an Ed25519 key pair for signing packages or trust roots"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path out_;
};

}  // namespace nadir
