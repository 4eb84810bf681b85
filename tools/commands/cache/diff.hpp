// nadir cache diff: what differs between two packages or tile sets.
#pragma once

#include <filesystem>

#include "cli/command.hpp"

namespace nadir {

class CacheDiffCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "diff"; }
  std::string_view summary() const override { return "name the tiles and facts that differ between two sets"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path before_;
  std::filesystem::path after_;
};

}  // namespace nadir
