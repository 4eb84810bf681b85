// What the commands that make permits (trust/permit.hpp) share: keys, scope, output. Each adds the step that its permit
// allows.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "trust/keys.hpp"
#include "trust/signed_document.hpp"

namespace nadir {

class PermitCommand : public Command {
 public:
  std::string_view group() const final { return "keys"; }
  bool offers_json() const final { return true; }

  void setup(Options& options) final;
  int run(Context& context) final;

 protected:
  using SigningKeys = std::vector<const PrivateKey*>;

  virtual void setup_step(Options& options) = 0;
  virtual void check_step() const = 0;       // throws UsageError
  virtual Figures step_figures() const = 0;  // of the step alone
  virtual SignedDocument sign(const SigningKeys& keys) const = 0;

  const std::optional<std::string>& airframe() const { return airframe_; }
  UtcTime expires() const { return expires_; }

 private:
  std::vector<std::filesystem::path> keys_;
  std::optional<std::string> airframe_;
  UtcTime expires_;
  std::filesystem::path out_;
};

}  // namespace nadir
