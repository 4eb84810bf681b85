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

std::string_view CacheValidateCommand::details() const {
  return "Decodes every tile and holds the set against the mission's sectors and corridor: gaps by place and area,\n"
         "damaged, wrongly sized, blank and wrongly addressed tiles. Freshness and resolution are judged only for "
         "files\n"
         "with Nadir's sidecars, because others do not say when they were captured. Exit code 0: good; 1: refused; 2:\n"
         "could not be checked.";
}

std::string_view CacheValidateCommand::examples() const {
  return "nadir cache validate others.mbtiles --mission mission.yaml\n"
         "nadir cache validate others.tif --mission mission.yaml";
}

void CacheValidateCommand::setup(Options& options) {
  options.positional("FILE", tiles_, "the tile set: MBTiles, or a COG on the grid of web maps").required();
  options.value("--mission", mission_, "MISSION.yaml", "what it is held against").required();
  options.value("--report", report_folder_, "DIR", "write the findings and a page with a map into this folder as well");
  options.value("--at", at_, "TIME", "judge as if it were this time");
}

int CacheValidateCommand::run(Context& context) {
  const Mission mission = read_mission(mission_);
  const UtcTime at = evaluation_time(at_, context.clock);
  const Validation validation = validate_tile_set(tiles_, mission, at, context.progress);
  const Figures figures{{"file", tiles_.string()},
                        {"tiles", std::to_string(validation.tiles)},
                        {"size", fmt::format("{:.1f} MB", static_cast<double>(validation.bytes) / 1e6)},
                        {"sidecars", validation.has_sidecars ? "yes" : "none: dates are not judged"}};
  if (report_folder_) {
    write_cache_report(*report_folder_, {.title = "Tile set " + tiles_.filename().string(),
                                         .subtitle = fmt::format("Held against mission {}", mission.id),
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
