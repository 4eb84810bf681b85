// nadir mission export: a mission for another program.
#include <fmt/format.h>

#include <filesystem>
#include <optional>
#include <ostream>
#include <string>

#include "base/error.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "commands/commands.hpp"
#include "mission_formats/mission_files.hpp"

namespace nadir {
namespace {

class MissionExportCommand final : public Command {
 public:
  std::string_view group() const override { return "mission"; }
  std::string_view name() const override { return "export"; }
  std::string_view summary() const override { return "write a mission for a ground station or a GIS program"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path mission_, out_;
  std::optional<std::string> format_;
};

std::string_view MissionExportCommand::details() const {
  return R"(Formats: KML and KMZ (Google Earth), GeoJSON and GeoPackage (QGIS), QGroundControl's .plan, and
MAVLink waypoints (QGC WPL 110). All but the waypoints carry the whole mission with them, so that
`nadir mission import` gives the same mission again, with what was moved in between.

Exit codes: 0 written, 2 the mission is not valid, or the format cannot state it.)";
}

std::string_view MissionExportCommand::examples() const {
  return R"(nadir mission export mission.yaml --out mission.plan
nadir mission export mission.yaml --format geojson --out mission.json)";
}

void MissionExportCommand::setup(Options& options) {
  options.positional("MISSION.yaml", mission_, "mission file").required();
  options.value("--format", format_, "FORMAT", "default: by the ending of --out")
      .one_of({"kml", "kmz", "geojson", "gpkg", "plan", "waypoints"});
  options.value("--out", out_, "FILE", "file to create; must not exist").required();
}

int MissionExportCommand::run(Context& context) {
  if (std::filesystem::exists(out_)) {
    throw UsageError({.what = "the file already exists", .where = out_.string(), .fix = "choose another --out"});
  }
  const std::string ending = out_.extension().string();
  const auto format = mission_format_of(format_ ? *format_ : ending.empty() ? "" : ending.substr(1));
  if (!format) {
    throw UsageError({.what = "it is unclear which format is wanted",
                      .where = out_.string(),
                      .expected = ".kml, .kmz, .geojson, .gpkg, .plan or .waypoints",
                      .found = ending,
                      .fix = "name it: --format"});
  }
  for (const std::string& what : write_mission_as(read_mission(mission_), *format, out_)) {
    if (!context.quiet) context.err << "left out: " << what << '\n';
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_mission_export() { return std::make_unique<MissionExportCommand>(); }

}  // namespace nadir
