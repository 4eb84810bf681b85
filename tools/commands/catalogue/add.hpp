// nadir catalogue add: a package becomes layers of a spatial database.
#pragma once

#include <filesystem>
#include <optional>

#include "cli/command.hpp"

namespace nadir {

class CatalogueAddCommand final : public Command {
 public:
  std::string_view group() const override { return "catalogue"; }
  std::string_view name() const override { return "add"; }
  std::string_view summary() const override { return "enter a package into a catalogue (SpatiaLite or PostGIS)"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path package_;
  std::string catalogue_;
  std::optional<std::filesystem::path> trust_;
  std::optional<UtcTime> at_;
};

}  // namespace nadir
