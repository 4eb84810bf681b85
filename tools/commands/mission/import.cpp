// nadir mission import: a mission file from what was drawn or planned in another program.
#include <fmt/format.h>

#include <array>
#include <filesystem>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "mission_formats/mission_drawing.hpp"

namespace nadir {
namespace {

class MissionImportCommand final : public Command {
 public:
  std::string_view group() const override { return "mission"; }
  std::string_view name() const override { return "import"; }
  std::string_view summary() const override { return "create a mission file from a plan or a drawing"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  MissionImportOptions options_;
  std::filesystem::path file_;
  std::optional<std::filesystem::path> mission_;
  std::string class_ = "active";
  std::optional<std::string> height_frame_;
  std::vector<std::string> no_fly_;
  bool latitude_first_ = false;
  std::filesystem::path out_;
};

std::string_view MissionImportCommand::details() const {
  return R"(Reads QGroundControl's .plan, MAVLink waypoints (QGC WPL 110), KML, KMZ, GeoJSON, GeoPackage and
other vector files. The line becomes the route, polygons become sectors; geofences that exclude, and
areas named "no-fly…", become no-fly areas. Without a line the mission is an area alone. A file that
`nadir mission export` wrote gives the same mission again. What a file does not state is filled in
with typical values, each on a line that ends with "# check": review them, then run
`nadir mission check`; or it is taken from --mission.

Exit codes: 0 written, 1 the drawing does not give a valid mission; nothing was written, 2 the file
cannot be read.)";
}

std::string_view MissionImportCommand::examples() const {
  return R"(nadir mission import flight.plan --id harbour-a --out mission.yaml
nadir mission import plan.geojson --id harbour-a --route north --half-width-m 80 --agl-m 150 --out mission.yaml
nadir mission import moved.waypoints --mission mission.yaml --out moved.yaml)";
}

void MissionImportCommand::setup(Options& options) {
  options.positional("FILE", file_, "plan or drawing").required();
  options.value("--id", options_.id, "ID", "id and series of the mission; needed without --mission");
  options.value("--mission", mission_, "MISSION.yaml", "mission that states everything that the file does not");
  options.value("--route", options_.route, "NAME", "name of the line that is the route, if there are several");
  options.value("--class", class_, "CLASS", "how fast the ground in new sectors changes").one_of({"stable", "active"});
  options.values("--no-fly", no_fly_, "NAME", "area that is a no-fly area; may be repeated");
  options.value("--buffer-m", options_.buffer_m, "METRES", "width that is added around each sector").between(0, 10'000);
  options
      .value("--half-width-m", options_.half_width_m, "METRES", "half width of the corridor; 100 if nothing states it")
      .between(1, 10'000)
      .formerly("--half-width");
  options.value("--agl-m", options_.agl_m, "METRES", "planned height above ground; 120 if nothing states it")
      .between(1, 10'000)
      .formerly("--agl");
  options.value("--ground-m", options_.ground_m, "METRES", "height of the ground above sea level at the take-off")
      .between(-500, 9000)
      .formerly("--height");
  options
      .value("--height-frame", height_frame_, "FRAME", "what the heights of a file that does not say are counted from")
      .one_of({"above_ground", "above_takeoff", "above_sea_level"});
  options.flag("--latitude-first", latitude_first_, "the file has latitude and longitude swapped");
  options.value("--out", out_, "MISSION.yaml", "mission file to create; must not exist").required();
}

int MissionImportCommand::run(Context& context) {
  if (std::filesystem::exists(out_)) {
    throw UsageError({.what = "the file already exists", .where = out_.string(), .fix = "choose another --out"});
  }
  options_.sector_class = class_ == "stable" ? SectorClass::stable : SectorClass::active;
  for (const HeightFrame frame :
       {HeightFrame::above_ground, HeightFrame::above_takeoff, HeightFrame::above_sea_level}) {
    if (height_frame_ && *height_frame_ == name_of(frame)) options_.height_frame = frame;
  }
  options_.no_fly = {no_fly_.begin(), no_fly_.end()};
  if (mission_) options_.base = read_mission(*mission_);
  options_.today = context.clock.now();
  const MissionDrawing drawing = read_mission_drawing(file_, latitude_first_);
  const ImportedMission imported = mission_from_drawing(drawing, options_, file_.string());
  if (!imported.reading.mission) {
    if (!context.quiet) context.err << "rejected: nothing was written\n";
    return report_findings(context.out, false, imported.reading.findings);
  }
  write_file_atomic(out_, imported.yaml);
  if (context.quiet) return kAccepted;
  for (const Finding& note : imported.notes.items()) context.err << to_text(note) << '\n';
  const Mission& mission = *imported.reading.mission;
  context.err << fmt::format(
      "{}: a route of {}{}, {}, {}; review the lines that end with \"# check\"\n", out_.string(),
      count(mission.route.points.size(), "point"),
      mission.route.heights_m.empty() ? "" : fmt::format(" with heights ({})", height_frames_of(mission.route)),
      count(mission.sectors.size(), "sector"), count(mission.no_fly.size(), "no-fly area"));
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_mission_import() { return std::make_unique<MissionImportCommand>(); }

}  // namespace nadir
