// nadir keys permit-rollback: allows aircraft to go back from one package to an older one.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"

namespace nadir {

class KeysPermitRollbackCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "permit-rollback"; }
  std::string_view summary() const override { return "permit aircraft to go back to an older package"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::vector<std::filesystem::path> keys_;
  std::string series_;
  std::int64_t from_ = 0;
  std::int64_t to_ = 0;
  std::optional<std::string> airframe_;
  UtcTime expires_;
  std::filesystem::path out_;
};

}  // namespace nadir
