#include "fuzz/targets.hpp"

namespace nadir::fuzz {

const std::vector<Target>& targets() {
  static const std::vector<Target> all{{"root", root},
                                       {"envelope", envelope},
                                       {"manifest", manifest},
                                       {"mission", mission},
                                       {"state", state},
                                       {"permit", permit},
                                       {"candidate", candidate},
                                       {"candidate_rows", candidate_rows},
                                       {"terrain", terrain},
                                       {"stac_item", stac_item},
                                       {"kml", kml},
                                       {"geojson", geojson},
                                       {"camera", camera},
                                       {"telemetry", telemetry},
                                       {"poses", poses},
                                       {"picture", picture},
                                       {"mbtiles", mbtiles},
                                       {"tile_rows", tile_rows},
                                       {"cog", cog},
                                       {"place_table", place_table},
                                       {"api_hint", api_hint},
                                       {"api_object", api_object},
                                       {"api_request", api_request},
                                       {"batch", batch},
                                       {"pack", pack},
                                       {"upload_request", upload_request},
                                       {"reply", reply},
                                       {"http_date", http_date},
                                       {"outbox", outbox},
                                       {"outbox_rows", outbox_rows},
                                       {"mavlink", mavlink},
                                       {"mcap", mcap}};
  return all;
}

}  // namespace nadir::fuzz
