// What a desk says of its flights: JSON documents (schemas/desk.openapi.json), server-sent events, and tracks as files
// for other programs.
//
// Degrees (WGS84), metres, seconds. Numbers that are not finite become null, text is printable UTF-8.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "desk/desk_service.hpp"
#include "desk/package_registry.hpp"
#include "flights/flight_store.hpp"

namespace nadir {

nlohmann::json package_json(const PackageListing& listing);
// In lists; and by itself, with what it is localized with and the number of its last event.
nlohmann::json flight_json(const FlightSummary& flight);
nlohmann::json flight_json(const FlightSummary& flight, const FlightStore& store);
nlohmann::json answers_json(std::span<const PictureAnswer> answers);
nlohmann::json estimate_json(std::size_t frame, const Estimate& estimate);
nlohmann::json segment_json(const FlightSegment& segment);
// seen, map: the images of the look. anew: at the place where its segment was placed, not in flight.
nlohmann::json look_json(std::size_t frame, const AnchorReport& look, const Bytes& seen, const Bytes& map, bool anew);

// "id: …\nevent: …\ndata: …\n\n": the event's members, with its time and its frame.
std::string event_text(const EventRow& event);

enum class TrackFormat { geojson, csv, kml, gpx, geo };  // geo: geo.txt of OpenDroneMap and OpenSfM
std::string_view name_of(TrackFormat format);
std::string_view ending_of(TrackFormat format);  // of its file's name
std::string_view media_type_of(TrackFormat format);
std::optional<TrackFormat> parse_track_format(std::string_view name);

// The estimates of one kind, by frame. KML and GPX have a line for each segment, GeoJSON one for the flight; all but
// GPX state the uncertainty of each frame. title: the flight's name.
std::string track_text(TrackFormat format, std::string_view title, const std::vector<Estimate>& estimates);

}  // namespace nadir
