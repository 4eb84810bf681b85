#include "cache_matchability.hpp"

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "framework/output.hpp"
#include "ground/matchability_tiff.hpp"
#include "tile_set_subject.hpp"

namespace nadir {

std::string_view CacheMatchabilityCommand::details() const {
  return "For places all over the mission's sectors and corridor a piece of the map, worn as if another season and\n"
         "sensor had seen it, is searched in the map around it as a flight does. A place is good where a frame may\n"
         "anchor on its own, weak where a healthy prediction has to agree, poor where no anchor is to be expected:\n"
         "water, bare fields, endless rows. Says how far the route runs without a good place.\n\n"
         "--out writes a GeoTIFF in EPSG:3857 with the bands ratio, entropy, texture, class, score and valid. Exit\n"
         "code 0: made; 2: could not be made.";
}

std::string_view CacheMatchabilityCommand::examples() const {
  return "nadir cache matchability package --camera camera.yaml --cruise-mps 22 --out matchability.tif\n"
         "nadir cache matchability others.mbtiles --mission mission.yaml --footprint-m 150 --step-m 50 --json";
}

void CacheMatchabilityCommand::setup(Options& options) {
  options.positional("PACKAGE|FILE", subject_, "the tile set: a package, MBTiles or COG").required();
  options.value("--mission", mission_, "MISSION.yaml", "whose ground is looked at; a package has its own");
  options.value("--out", out_, "FILE.tif", "write the map as a GeoTIFF");
  request_.declare(options);
}

int CacheMatchabilityCommand::run(Context& context) {
  const auto [tiles, manifest, own_mission] = find_tile_set(subject_);
  if (!mission_ && own_mission.empty()) {
    throw UsageError({.what = "no mission that says which ground is looked at",
                      .where = subject_.string(),
                      .expected = "--mission MISSION.yaml, or a package, which has its mission inside"});
  }
  const Mission mission = read_mission(mission_.value_or(own_mission));
  const MatchabilityResult result = make_matchability(tiles, mission, request_, context.progress);
  if (out_) write_matchability_tiff(result.map, *out_);
  if (context.json) {
    print_json(context.out, json_of(result));
  } else {
    print_figures(context.out, figures_of(result));
  }
  return kAccepted;
}

}  // namespace nadir
