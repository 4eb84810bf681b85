// nadir cache validate: anybody's MBTiles or COG against a mission, without signature.
#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "base/time.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/cache_report.hpp"
#include "commands/commands.hpp"
#include "package/validate.hpp"

namespace nadir {
namespace {

class CacheValidateCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "validate"; }
  std::string_view summary() const override { return "check any MBTiles file or COG against a mission"; }
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

std::string_view CacheValidateCommand::details() const {
  return R"(Decodes every tile and checks the set against the mission's sectors and corridor: gaps by place and
area; damaged, wrongly sized, blank and wrongly addressed tiles. Age and resolution are checked only
for files with Nadir's sidecars, because others do not state when they were captured.

Exit codes: 0 accepted, 1 rejected, 2 the check could not be done.)";
}

std::string_view CacheValidateCommand::examples() const {
  return R"(nadir cache validate others.mbtiles --mission mission.yaml
nadir cache validate others.tif --mission mission.yaml)";
}

void CacheValidateCommand::setup(Options& options) {
  options.positional("FILE", tiles_, "tile set: MBTiles, or a COG on the web map grid").required();
  options.value("--mission", mission_, "MISSION.yaml", "mission to check against").required();
  options.value("--report", report_folder_, "DIR", "also write the findings and a page with a map to this folder");
  options.value("--at", at_, "TIME", "evaluate ages as of this time");
}

int CacheValidateCommand::run(Context& context) {
  const Mission mission = read_mission(mission_);
  const UtcTime at = evaluation_time(at_, context.clock);
  const Validation validation = validate_tile_set(tiles_, mission, at, context.progress);
  const Figures figures{{"file", tiles_.string()},
                        {"tiles", std::to_string(validation.tiles)},
                        {"size", fmt::format("{:.1f} MB", static_cast<double>(validation.bytes) / 1e6)},
                        {"sidecars", validation.has_sidecars ? "yes" : "none: ages are not checked"}};
  if (report_folder_) {
    write_cache_report(*report_folder_, {.title = "Tile set " + tiles_.filename().string(),
                                         .subtitle = fmt::format("Checked against mission {}", mission.id),
                                         .at = at,
                                         .findings = validation.findings,
                                         .figures = figures,
                                         .mission = mission,
                                         .tiles = validation.sidecars,
                                         .dated = validation.has_sidecars});
  }
  if (!context.json) print_figures(context.out, figures);
  const nlohmann::json more{{"file", tiles_.string()},
                            {"tiles", validation.tiles},
                            {"bytes", validation.bytes},
                            {"has_sidecars", validation.has_sidecars}};
  return report_findings(context.out, context.json, validation.findings, more);
}

}  // namespace

std::unique_ptr<Command> make_cache_validate() { return std::make_unique<CacheValidateCommand>(); }

}  // namespace nadir
