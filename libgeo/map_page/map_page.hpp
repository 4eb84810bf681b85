// The map of our web pages: the texts that a page is made of, and the tiles that it asks for.
//
//   leaflet_script, leaflet_style   Leaflet 1.7.1 as Debian builds it
//   calls.js    calls to a service: with the token when there is one, and an event stream that is resumed
//   map.js      FlightMap: a package's tiles, tracks by segment or source, error ellipses, protection levels, fixes
//
// calls.js and map.js are joined with a page's own script; both expect `element` of report/dom.js.
#pragma once

#include <string_view>

#include "http/message.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

namespace map_page {

extern const std::string_view leaflet_script;
extern const std::string_view leaflet_style;
extern const std::string_view calls;
extern const std::string_view map;

}  // namespace map_page

// The tile of "ZOOM/COLUMN/ROW", rows from the north; 404 where there is none. tiles: null for none at all.
ApiResponse tile_answer(const TileSource* tiles, std::string_view address);

}  // namespace nadir
