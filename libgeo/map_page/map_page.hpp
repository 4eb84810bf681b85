// The map of our web pages: the texts that a page is made of, and the tiles that it asks for.
//
//   leaflet_script, leaflet_style   Leaflet 1.7.1 as Debian builds it
//   drawing_script                  Leaflet.Editable 1.3.2: lines and polygons that are drawn and changed; after
//   Leaflet calls.js      calls to a service: with the token when there is one, and an event stream that is resumed
//   base_map.js   the map beneath all pages: controls, a package's tiles, ellipses; with it comes
//   vectors.js    a package's roads, water, woods and buildings
//   map.js        FlightMap: tracks by segment, error ellipses, protection levels, fixes, marked objects
//   picture.js    a frame's picture, beside the map and laid on it
//
// They are joined in this order with a page's own script, which has `element` of report/dom.js.
#pragma once

#include <optional>
#include <string_view>

#include "http/message.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

namespace map_page {

extern const std::string_view leaflet_script;
extern const std::string_view leaflet_style;
extern const std::string_view drawing_script;
extern const std::string_view calls;
extern const std::string_view base_map;
extern const std::string_view flight_map;
extern const std::string_view picture;

}  // namespace map_page

// The tile of "ZOOM/COLUMN/ROW", rows from the north. 204 where the map has none, because a map's edge is no error in a
// browser's console; 404 for what is no address. tiles: null for none at all, 404.
ApiResponse tile_answer(const TileSource* tiles, std::string_view address);

// A package's vectors as they stand in it, GeoJSON; 204 where it has none.
ApiResponse vectors_answer(std::optional<Bytes> vectors);

}  // namespace nadir
