// nadir cache validate: anybody's MBTiles or COG against a mission, without signature.
#pragma once

#include <filesystem>
#include <optional>

#include "base/time.hpp"
#include "cli/command.hpp"

namespace nadir {

class CacheValidateCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "validate"; }
  std::string_view summary() const override { return "judge any MBTiles file or COG against a mission"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path tiles_;
  std::filesystem::path mission_;
  std::optional<std::filesystem::path> report_folder_;
  std::optional<UtcTime> at_;
};

}  // namespace nadir
