#include "api/state_json.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/printable.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using nlohmann::json;

json number(double value) { return std::isfinite(value) ? json(value) : json(); }
json number(const std::optional<double>& value) { return value ? number(*value) : json(); }
json angle_deg(const std::optional<double>& angle_rad) { return angle_rad ? number(degrees(*angle_rad)) : json(); }
json heading_deg(const std::optional<double>& heading_rad) {
  if (!heading_rad) return {};
  const double turn = std::fmod(degrees(*heading_rad), 360);
  return number(turn < 0 ? turn + 360 : turn);
}
json place(LonLat place) { return json::array({number(place.lon_deg), number(place.lat_deg)}); }
json utc(const std::optional<UtcTime>& time) { return time ? json(to_rfc3339(*time)) : json(); }

json counts(const CountsByReason& counts) {
  json object = json::object();
  for (const auto& [reason, count] : counts) object[printable(reason)] = count;
  return object;
}

// The covariance as people draw it: half axes of one sigma, and the bearing of the longer one.
json ellipse(const PositionView& position) {
  const double mean = 0.5 * (position.east_var_m2 + position.north_var_m2);
  const double half_gap = 0.5 * (position.east_var_m2 - position.north_var_m2);
  const double radius = std::hypot(half_gap, position.east_north_cov_m2);
  const double from_east_rad = 0.5 * std::atan2(position.east_north_cov_m2, half_gap);
  double bearing_deg = 90 - degrees(from_east_rad);
  if (bearing_deg >= 180) bearing_deg -= 180;
  return {{"major_m", number(std::sqrt(std::max(0.0, mean + radius)))},
          {"minor_m", number(std::sqrt(std::max(0.0, mean - radius)))},
          {"bearing_deg", number(bearing_deg)}};
}

json position_json(const std::optional<PositionView>& position) {
  if (!position) return {};
  return {{"lon", number(position->place.lon_deg)},
          {"lat", number(position->place.lat_deg)},
          {"sigma_m", number(position->sigma_m)},
          {"covariance_m2",
           {number(position->east_var_m2), number(position->east_north_cov_m2), number(position->north_var_m2)}},
          {"ellipse", ellipse(*position)}};
}

}  // namespace

json state_json(const FlightView& view, double age_s) {
  json document{{"boot", printable(view.boot_id)},
                {"version", view.version},
                {"time_s", number(view.time_s)},
                {"utc", utc(view.utc)},
                {"age_s", number(age_s)},
                {"state", name_of(view.state.state)},
                {"reason", printable(view.state.reason)},
                {"state_for_s", number(view.time_s - view.state.since_s)},
                {"position", position_json(view.position)},
                {"source", name_of(view.source)},
                {"anchor_age_s", number(view.anchor_age_s)},
                {"heading_deg", heading_deg(view.heading_rad)},
                {"pitch_deg", angle_deg(view.pitch_rad)},
                {"roll_deg", angle_deg(view.roll_rad)},
                {"velocity", nullptr},
                {"agl_m", number(view.agl_m)}};
  if (view.velocity) {
    document["velocity"] = {{"east_m_s", number(view.velocity->east_mps)},
                            {"north_m_s", number(view.velocity->north_mps)}};
  }
  document["frames"] = {
      {"received", view.frames.received}, {"dropped", view.frames.dropped}, {"per_s", number(view.frames.per_s)}};
  document["anchors"] = {{"accepted", view.anchors.accepted},
                         {"rejected", view.anchors.rejected},
                         {"rejected_by", counts(view.anchors.rejected_by)}};
  document["link"] = {{"connected", view.link.connected},
                      {"signed", view.link.signed_frames},
                      {"fixes_sent", view.link.fixes_sent},
                      {"rejected_by", counts(view.link.rejected_by)}};
  document["gps"] = {{"judgement", name_of(view.gps.judgement)}, {"reason", printable(view.gps.reason)}};
  document["recorder"] = {{"state", name_of(view.recorder.state)},
                          {"reason", printable(view.recorder.reason)},
                          {"written_bytes", view.recorder.written_bytes},
                          {"free_bytes", view.recorder.free_bytes},
                          {"lost_records", view.recorder.lost_records}};
  return document;
}

json event_json(const FlightEvent& event, const FlightView& view) {
  return {{"id", event.id},
          {"time_s", number(event.time_s)},
          {"age_s", number(view.time_s - event.time_s)},
          {"severity", name_of(event.severity)},
          {"kind", printable(event.kind)},
          {"text", printable(event.text)}};
}

json track_json(const FlightView& view) {
  json points = json::array();
  for (const TrackPoint& point : view.track) {
    points.push_back({{"lon", number(point.place.lon_deg)},
                      {"lat", number(point.place.lat_deg)},
                      {"sigma_m", number(point.sigma_m)},
                      {"source", name_of(point.source)}});
  }
  return points;
}

json package_json(const PackageView& package) {
  json route = json::array();
  for (const LonLat& point : package.route) route.push_back(place(point));
  json document{{"accepted", package.accepted},
                {"reason", printable(package.reason)},
                {"mission", printable(package.mission)},
                {"series", printable(package.series)},
                {"sequence", package.sequence},
                {"expires", utc(package.expires)},
                {"min_zoom", package.min_zoom},
                {"max_zoom", package.max_zoom},
                {"tiles", package.tiles},
                {"terrain", package.terrain},
                {"bounds", nullptr},
                {"route", std::move(route)}};
  if (package.bounds) {
    const LonLatBox& box = *package.bounds;
    document["bounds"] = {number(box.west_deg), number(box.south_deg), number(box.east_deg), number(box.north_deg)};
  }
  return document;
}

}  // namespace nadir
