// nadir-candidates export: promoted tiles as imagery for the next map.
#pragma once

#include <filesystem>

#include "cli/command.hpp"

namespace nadir {

class ExportCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "export"; }
  std::string_view summary() const override { return "write the promoted tiles as imagery for `nadir cache build`"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path data_, out_;
  std::string catalogue_;
};

}  // namespace nadir
