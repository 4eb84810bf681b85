// The paths of a desk's API: where each leads, and which methods, bodies and sizes it takes. Whether a request is
// answered at all is decided here, by its header.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "http/message.hpp"

namespace nadir {

inline constexpr std::uint64_t kMaxJsonBody = 64 * 1024;
inline constexpr std::uint64_t kMaxMissionBody = std::uint64_t{4} << 20;
inline constexpr std::uint64_t kMaxDrawingBody = std::uint64_t{32} << 20;  // a plan or drawing of another program

enum class DeskPath {
  page,
  script,
  style,
  leaflet_script,
  leaflet_style,
  health,
  contract,
  packages,
  tile,
  vectors,
  imports,
  import_files,
  import_flight,
  import_item,
  flights,
  flight,
  pictures,
  picture,
  events,
  estimates,
  segments,
  merge,
  look,
  seen,
  map,
  footprint,
  fixes,
  fix,
  objects,
  object,
  sightings,
  sighting,
  complete,
  export_track,
  missions_page,
  missions_script,
  missions_style,
  drawing_script,
  planning,  // from here on: is_mission_path()
  imagery_tile,
  missions,
  mission_import,
  mission,
  mission_file,
  mission_profile,
  mission_tile,
  mission_layer,
  mission_jobs,
  mission_job,
  mission_package
};

struct DeskRoute {
  DeskPath path = DeskPath::page;
  std::string_view methods = "GET, HEAD";
  std::string_view media{};  // of the body, separated by blanks; empty: there is none
  std::uint64_t body_max = 0;
  std::string name{};     // of the flight, the package, the import, the mission or the raster
  std::string tile{};     // "ZOOM/COLUMN/ROW", or the name of a layer
  std::size_t frame = 0;  // of a picture, a look or a footprint
  std::int64_t item = 0;  // a fix, an object or a segment
  std::int64_t part = 0;  // a sighting of an object
};

// Nothing: there is no such path. picture_bytes: the most that a batch of pictures may have.
std::optional<DeskRoute> desk_route(std::string_view path, std::string_view method, std::uint64_t picture_bytes);

// Why the header alone is reason to refuse the request.
std::optional<ApiResponse> refusal(const DeskRoute& route, const ApiRequest& header);

// Requests of one lane are answered one after the other, those of different lanes at the same time.
std::string lane_of(const DeskRoute& route);

// A number in a path or a query, at most 1e9.
std::optional<std::size_t> index_from(std::string_view text);

}  // namespace nadir
