// nadir catalogue list: which packages there are.
#pragma once

#include <optional>

#include "cli/command.hpp"

namespace nadir {

class CatalogueListCommand final : public Command {
 public:
  std::string_view group() const override { return "catalogue"; }
  std::string_view name() const override { return "list"; }
  std::string_view summary() const override { return "list the packages of a catalogue and what was made from what"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string catalogue_;
  std::optional<UtcTime> at_;
};

}  // namespace nadir
