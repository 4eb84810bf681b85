// nadir cache gaps: what a mission lacks in a tile set, as GeoJSON.
#pragma once

#include <filesystem>
#include <optional>

#include "cli/command.hpp"

namespace nadir {

class CacheGapsCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "gaps"; }
  std::string_view summary() const override { return "outline what a mission lacks in a tile set, as GeoJSON"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path subject_;
  std::optional<std::filesystem::path> mission_;
  std::optional<std::int64_t> zoom_;
  std::optional<std::filesystem::path> out_;
};

}  // namespace nadir
