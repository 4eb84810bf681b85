// nadir keys revoke: the next root of trust, in which a key counts for nothing any more.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "trust/root.hpp"

namespace nadir {

class KeysRevokeCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "revoke"; }
  std::string_view summary() const override { return "make the next root, in which a key is revoked"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path previous_;
  std::vector<std::string> revoked_;
  std::vector<std::filesystem::path> root_keys_;
  std::vector<std::filesystem::path> new_root_keys_;
  std::vector<std::filesystem::path> new_package_signers_;
  std::vector<std::filesystem::path> new_airframe_signers_;
  std::optional<UtcTime> expires_;
  bool incomplete_ = false;
  std::filesystem::path out_;
};

}  // namespace nadir
