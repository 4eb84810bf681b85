// nadir keys sign: one more signature for a root of trust or a rollback permit, so that several people can sign it.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "trust/root.hpp"

namespace nadir {

class KeysSignCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "sign"; }
  std::string_view summary() const override { return "add a signature to a root or to a rollback permit"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  Findings sign_root_file(const std::string& text, const std::vector<PrivateKey>& keys, std::string& result) const;
  Findings sign_permit_file(const std::string& text, const std::vector<PrivateKey>& keys, UtcTime at,
                            std::string& result) const;

  std::filesystem::path file_;
  std::vector<std::filesystem::path> keys_;
  std::optional<std::filesystem::path> previous_;
  std::optional<std::filesystem::path> trust_;
};

}  // namespace nadir
