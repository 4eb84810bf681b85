// nadir mission import: a mission file from a route and areas that were drawn in another program.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <ostream>
#include <set>
#include <string>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "package/mission.hpp"
#include "package_build/vector_features.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kSecondsPerDay = 86'400;

const VectorFeature& choose_route(const VectorFeatures& plan, const std::optional<std::string>& name,
                                  const std::string& where) {
  const VectorFeature* chosen = nullptr;
  std::size_t matching = 0;
  std::string names;
  for (const VectorFeature& line : plan.lines) {
    names += (names.empty() ? "\"" : ", \"") + printable(line.name) + "\"";
    if (name && line.name != *name) continue;
    chosen = &line;
    ++matching;
  }
  if (matching == 1) return *chosen;
  throw UsageError(
      {.what = "it is unclear which line is the route",
       .where = where,
       .expected = name ? "one line named \"" + *name + "\"" : "one line",
       .found = plan.lines.empty() ? "no lines" : fmt::format("{}: {}", count(plan.lines.size(), "line"), names),
       .fix = plan.lines.empty() ? "draw the route as a line" : "select one: --route NAME"});
}

// Ids take letters, digits, '-', '_' and '.'.
std::string id_from(const std::string& name, const std::string& otherwise, std::set<std::string>& taken) {
  std::string id;
  for (const char c : name) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    if (plain || (!id.empty() && (c == '-' || c == '_' || c == '.'))) {
      id += c;
    } else if (!id.empty() && id.back() != '-') {
      id += '-';
    }
  }
  id = id.substr(0, 56);
  while (!id.empty() && id.back() == '-') id.pop_back();
  if (id.empty()) id = otherwise;
  std::string unique = id;
  for (int n = 2; !taken.insert(unique).second; ++n) unique = fmt::format("{}-{}", id, n);
  return unique;
}

std::string points_yaml(const std::vector<LonLat>& points) {
  std::string yaml;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i > 0 && points[i] == points[i - 1]) continue;
    yaml += fmt::format("{}[{:.7f}, {:.7f}]", yaml.empty() ? "" : ", ", points[i].lon_deg, points[i].lat_deg);
  }
  return "[" + yaml + "]";
}

class MissionImportCommand final : public Command {
 public:
  std::string_view group() const override { return "mission"; }
  std::string_view name() const override { return "import"; }
  std::string_view summary() const override { return "create a mission file from a drawn route and areas"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path file_;
  std::string id_;
  std::optional<std::string> route_;
  std::string class_ = "active";
  double half_width_m_ = 100;
  double agl_m_ = 120;
  double height_m_ = 0;
  std::filesystem::path out_;
};

std::string_view MissionImportCommand::details() const {
  return R"(The single line of the file becomes the route, its first point the take-off; polygons become
sectors, named after the features. What a drawing does not state is filled in with typical values,
each on a line that ends with "# check": review them, then run `nadir mission check`.

Exit codes: 0 written, 1 the drawing does not give a valid mission; nothing was written, 2 the file
cannot be read.)";
}

std::string_view MissionImportCommand::examples() const {
  return R"(nadir mission import plan.kml --id harbour-a --out mission.yaml
nadir mission import plan.geojson --id harbour-a --route north --half-width-m 80 --agl-m 150 --out mission.yaml)";
}

void MissionImportCommand::setup(Options& options) {
  options.positional("FILE.kml|FILE.geojson", file_, "drawing: any vector file that GDAL reads").required();
  options.value("--id", id_, "ID", "id and series of the mission").required();
  options.value("--route", route_, "NAME", "name of the line that is the route, if there are several");
  options.value("--class", class_, "CLASS", "how fast the ground in the sectors changes").one_of({"stable", "active"});
  options.value("--half-width-m", half_width_m_, "METRES", "half width of the corridor")
      .between(1, 10'000)
      .formerly("--half-width");
  options.value("--agl-m", agl_m_, "METRES", "planned height above ground").between(1, 10'000).formerly("--agl");
  options.value("--ground-m", height_m_, "METRES", "height of the ground above sea level at the take-off")
      .between(-500, 9000)
      .formerly("--height");
  options.value("--out", out_, "MISSION.yaml", "mission file to create; must not exist").required();
}

int MissionImportCommand::run(Context& context) {
  if (std::filesystem::exists(out_)) {
    throw UsageError({.what = "the file already exists", .where = out_.string(), .fix = "choose another --out"});
  }
  const VectorFeatures plan = read_vector_features(file_);
  const VectorFeature& route = choose_route(plan, route_, file_.string());
  if (route.points.empty()) throw UsageError({.what = "the route has no points", .where = file_.string()});
  const UtcTime today{context.clock.now().unix_s / kSecondsPerDay * kSecondsPerDay};

  std::string yaml = fmt::format(
      "schema: nadir.mission/1\nid: {0}\nseries: {0}\nsequence: 1\ncreated: {1}\nexpires: {2}  # check\n"
      "takeoff: {{lon_deg: {3:.7f}, lat_deg: {4:.7f}}}  # check: the route's first point\n"
      "terrain: {{mode: flat, height_m: {5}}}  # check\nzoom: {{min: 15, max: 19}}  # check\n"
      "min_resolution_m: 0.5  # check\nbudget_mb: 500  # check\nfreshness_days: {{stable: 730, active: 90}}  # check\n"
      "airframes: [any]  # check\n",
      id_, to_rfc3339(today), to_rfc3339(UtcTime{today.unix_s + 30 * kSecondsPerDay}), route.points.front().lon_deg,
      route.points.front().lat_deg, height_m_);
  yaml += plan.areas.empty() ? "sectors: []\n" : "sectors:\n";
  std::set<std::string> taken;
  for (const VectorFeature& area : plan.areas) {
    const std::string id = id_from(area.name, "sector", taken);
    yaml +=
        fmt::format("  - id: \"{}\"\n    class: {}  # check\n    polygon: {}\n", id, class_, points_yaml(area.points));
  }
  yaml += fmt::format("route:\n  corridor_half_width_m: {}  # check\n  agl_m: {}  # check\n  points: {}\n",
                      half_width_m_, agl_m_, points_yaml(route.points));

  const MissionReading reading = parse_mission(yaml, "the mission from " + file_.string());
  if (!reading.mission) {
    if (!context.quiet) context.err << "rejected: nothing was written\n";
    return report_findings(context.out, false, reading.findings);
  }
  write_file_atomic(out_, yaml);
  if (!context.quiet) {
    context.err << fmt::format("{}: a route of {} and {}; review the lines that end with \"# check\"\n", out_.string(),
                               count(reading.mission->route.points.size(), "point"),
                               count(reading.mission->sectors.size(), "sector"));
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_mission_import() { return std::make_unique<MissionImportCommand>(); }

}  // namespace nadir
