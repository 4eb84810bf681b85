// nadir cache inspect: what is in a package, an MBTiles file or a COG, without judging it.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "cli/command.hpp"

namespace nadir {

class CacheInspectCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "inspect"; }
  std::string_view summary() const override { return "show what is in a package, an MBTiles file or a COG"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path subject_;
  std::optional<std::string> get_;
};

}  // namespace nadir
