// nadir keys root: makes and signs a root of trust, the file that says whose packages an aircraft believes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "trust/root.hpp"

namespace nadir {

class KeysRootCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "root"; }
  std::string_view summary() const override { return "make the root of trust: who may sign packages, until when"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  TrustRoot describe(const std::vector<PrivateKey>& root_keys, const std::optional<TrustRoot>& previous) const;

  std::vector<std::filesystem::path> root_keys_;
  std::vector<std::filesystem::path> previous_root_keys_;
  std::vector<std::filesystem::path> root_public_keys_;
  std::vector<std::filesystem::path> package_signers_;
  std::vector<std::filesystem::path> airframe_signers_;
  std::vector<std::string> tile_signers_;
  int threshold_ = 1;
  int root_threshold_ = 1;
  UtcTime expires_;
  bool incomplete_ = false;
  std::optional<std::filesystem::path> previous_;
  std::filesystem::path out_;
};

}  // namespace nadir
