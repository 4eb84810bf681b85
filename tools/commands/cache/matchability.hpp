// nadir cache matchability: where over the mission's ground will frames find their place on the map, and where not?
#pragma once

#include <filesystem>
#include <optional>

#include "cli/command.hpp"
#include "commands/cache/matchability_request.hpp"

namespace nadir {

class CacheMatchabilityCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "matchability"; }
  std::string_view summary() const override { return "map where frames will find their place, and where not"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void check_options() const;
  int put_into_package(Context& context);

  std::filesystem::path subject_;
  std::optional<std::filesystem::path> mission_;
  std::optional<std::filesystem::path> out_;
  bool into_package_ = false;
  std::optional<std::filesystem::path> key_;
  MatchabilityRequest request_;
};

}  // namespace nadir
