#include "commands/cache/gaps.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/cache/gaps_geojson.hpp"
#include "package/validate.hpp"
#include "commands/cache/tile_set_subject.hpp"

namespace nadir {

std::string_view CacheGapsCommand::details() const {
  return "Decodes the tiles and outlines, pixel by pixel, what the mission's sectors and corridor need and what is\n"
         "not there: one feature per tile with its address, area and the sector that it lies in. At the finest zoom\n"
         "empty pixels count as well as absent tiles, at the others absent tiles alone. Without --out the GeoJSON\n"
         "goes to standard output. A package is held against its own mission unless --mission names another. Exit\n"
         "code 0: no gaps; 1: there are some; 2: could not be judged.";
}

std::string_view CacheGapsCommand::examples() const {
  return "nadir cache gaps package --out gaps.geojson\n"
         "nadir cache gaps others.mbtiles --mission mission.yaml --zoom 17 | jq .features[].properties";
}

void CacheGapsCommand::setup(Options& options) {
  options.positional("PACKAGE|FILE", subject_, "the tile set: a package, MBTiles or COG").required();
  options.value("--mission", mission_, "MISSION.yaml", "what it is held against; a package has its own");
  options.value("--zoom", zoom_, "N", "the zoom that is looked at; the mission's finest when not given")
      .between(0, kMaxZoom);
  options.value("--out", out_, "FILE.geojson", "where the outlines go; standard output when not given");
}

int CacheGapsCommand::run(Context& context) {
  const TileSetSubject subject = find_tile_set(subject_);
  if (!mission_ && subject.mission.empty()) {
    throw UsageError({.what = "no mission to hold the tile set against",
                      .where = subject_.string(),
                      .expected = "--mission MISSION.yaml, or a package, which has its mission inside"});
  }
  const Mission mission = read_mission(mission_.value_or(subject.mission));
  const int zoom = static_cast<int>(zoom_.value_or(mission.zoom.max));
  if (zoom < mission.zoom.min || zoom > mission.zoom.max) {
    throw UsageError({.what = "the mission does not ask for this zoom",
                      .where = "--zoom",
                      .expected = fmt::format("{} to {}", mission.zoom.min, mission.zoom.max),
                      .found = std::to_string(zoom)});
  }
  // Dates are nobody's business here: the mission's own will do.
  const Validation validation = validate_tile_set(subject.tiles, mission, mission.created, context.progress);
  const std::vector<Gap> gaps = find_gaps(mission, validation.sidecars, zoom);
  const nlohmann::json document = gaps_geojson(gaps, mission, validation.sidecars);
  if (out_) {
    write_file_atomic(*out_, document.dump(1) + "\n");
    double area_m2 = 0;
    for (const Gap& gap : gaps) area_m2 += gap.area_m2;
    context.out << fmt::format("zoom {}: {} tiles with gaps, {:.0f} m² in all\n", zoom, gaps.size(), area_m2);
  } else {
    print_json(context.out, document);
  }
  return gaps.empty() ? kAccepted : kRefused;
}

}  // namespace nadir
