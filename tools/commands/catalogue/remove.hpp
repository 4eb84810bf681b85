// nadir catalogue remove: a package and all that belongs to it goes.
#pragma once

#include <cstdint>

#include "cli/command.hpp"

namespace nadir {

class CatalogueRemoveCommand final : public Command {
 public:
  std::string_view group() const override { return "catalogue"; }
  std::string_view name() const override { return "remove"; }
  std::string_view summary() const override { return "take a package out of a catalogue"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::string series_;
  std::int64_t sequence_ = 0;
  std::string catalogue_;
};

}  // namespace nadir
