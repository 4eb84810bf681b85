// The table of a place index: what index/places.json may hold.
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "vision/place_table.hpp"

namespace nadir::fuzz {

void place_table(std::string_view bytes) {
  refusing([&] {
    const PlaceTable first = parse_place_table(bytes, "fuzz");
    std::size_t chunks = 0;
    for (const PlaceLayer& layer : first.layers) chunks += layer.count;
    require(chunks == first.chunks.size(), "layers that do not hold the chunks");
    const std::string written = place_table_json(first);
    require(place_table_json(parse_place_table(written, "again")) == written, "a table changes when it is written");
  });
}

}  // namespace nadir::fuzz
