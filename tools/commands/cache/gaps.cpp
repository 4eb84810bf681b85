// nadir cache gaps: what a mission lacks in a tile set, as GeoJSON.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <ostream>
#include <span>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/tile_set_subject.hpp"
#include "commands/commands.hpp"
#include "package/coverage_gaps.hpp"
#include "package/mission_check.hpp"
#include "package/validate.hpp"
#include "planning/package_layers.hpp"

namespace nadir {
namespace {

class CacheGapsCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "gaps"; }
  std::string_view summary() const override { return "outline a mission's coverage gaps in a tile set, as GeoJSON"; }
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

std::string_view CacheGapsCommand::details() const {
  return R"(Decodes the tiles and outlines, pixel by pixel, the parts of the mission's sectors and corridor
that are missing: one feature per tile with its address, area and sector. At the finest zoom both
empty pixels and absent tiles count, at the others absent tiles only. Without --out the GeoJSON
goes to standard output. A package is checked against its own mission unless --mission names
another.

Exit codes: 0 no gaps, 1 there are gaps, 2 the check could not be done.)";
}

std::string_view CacheGapsCommand::examples() const {
  return R"(nadir cache gaps package --out gaps.geojson
nadir cache gaps others.mbtiles --mission mission.yaml --zoom 17 | jq .features[].properties)";
}

void CacheGapsCommand::setup(Options& options) {
  options.positional("PACKAGE|FILE", subject_, "tile set: a package, MBTiles file or COG").required();
  options.value("--mission", mission_, "MISSION.yaml", "mission to check against; a package contains its own");
  options.value("--zoom", zoom_, "N", "zoom to check; default: the mission's finest").between(0, kMaxZoom);
  options.value("--out", out_, "FILE.geojson", "where the outlines go; default: standard output");
}

int CacheGapsCommand::run(Context& context) {
  const TileSetSubject subject = find_tile_set(subject_);
  if (!mission_ && subject.mission.empty()) {
    throw UsageError({.what = "no mission to check the tile set against",
                      .where = subject_.string(),
                      .expected = "--mission MISSION.yaml, or a package, which contains its mission"});
  }
  const Mission mission = read_mission(mission_.value_or(subject.mission));
  const int zoom = static_cast<int>(zoom_.value_or(mission.zoom.max));
  if (zoom < mission.zoom.min || zoom > mission.zoom.max) {
    throw UsageError({.what = "the mission does not require this zoom",
                      .where = "--zoom",
                      .expected = fmt::format("{} to {}", mission.zoom.min, mission.zoom.max),
                      .found = std::to_string(zoom)});
  }
  // Ages do not matter here.
  const Validation validation = validate_tile_set(subject.tiles, mission, mission.created, context.progress);
  const std::vector<Gap> gaps = find_gaps(mission, validation.sidecars, zoom);
  const nlohmann::json document = gaps_geojson(gaps, mission, validation.sidecars);
  if (out_) {
    write_file_atomic(*out_, document.dump(1) + "\n");
    double area_m2 = 0;
    for (const Gap& gap : gaps) area_m2 += gap.area_m2;
    context.out << fmt::format("zoom {}: {} with gaps, {:.0f} m² in total\n", zoom, count(gaps.size(), "tile"),
                               area_m2);
  } else {
    print_json(context.out, document);
  }
  return gaps.empty() ? kAccepted : kRefused;
}

}  // namespace

std::unique_ptr<Command> make_cache_gaps() { return std::make_unique<CacheGapsCommand>(); }

}  // namespace nadir
