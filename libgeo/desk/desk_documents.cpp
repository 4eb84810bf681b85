#include "desk/desk_documents.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/printable.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/error_ellipse.hpp"
#include "replay/track_files.hpp"
#include "report/page_text.hpp"

namespace nadir {
namespace {

using nlohmann::json;

json number(double value) { return std::isfinite(value) ? json(value) : json(); }
json number(const std::optional<double>& value) { return value ? number(*value) : json(); }
json place(const LonLat& at) { return {{"lon", number(at.lon_deg)}, {"lat", number(at.lat_deg)}}; }
json place(const std::optional<LonLat>& at) { return at ? place(*at) : json(); }

std::string state_of(const FlightSummary& flight) {
  if (!flight.damaged.empty()) return "damaged";
  if (flight.status.activity != FlightActivity::idle) return std::string(name_of(flight.status.activity));
  if (flight.status.processed < flight.status.accepted) return "waiting";
  return flight.status.completed ? "completed" : "idle";
}

// The runs of frames of one segment that have a position, as indices into the estimates.
std::vector<std::vector<std::size_t>> lines_of(const std::vector<Estimate>& estimates) {
  std::vector<std::vector<std::size_t>> lines;
  int segment = 0;
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    if (!estimates[i].position) continue;
    if (lines.empty() || estimates[i].segment != segment) lines.emplace_back();
    segment = estimates[i].segment;
    lines.back().push_back(i);
  }
  return lines;
}

std::string csv_text(const std::vector<Estimate>& estimates) {
  std::string text = EstimatesCsv::header() + "\n";
  for (const Estimate& estimate : estimates) text += EstimatesCsv::row(estimate) + "\n";
  return text;
}

// A name with a space would be read as a name and a number.
std::string geo_text(const std::vector<Estimate>& estimates) {
  std::string text = "EPSG:4326\n";
  for (const Estimate& estimate : estimates) {
    const bool plain = estimate.frame.find_first_of(" \t\r\n") == std::string::npos && !estimate.frame.empty();
    if (!estimate.position || !plain) continue;
    text += fmt::format("{} {:.9f} {:.9f}\n", estimate.frame, estimate.position->lon_deg, estimate.position->lat_deg);
  }
  return text;
}

std::string kml_text(std::string_view title, const std::vector<Estimate>& estimates) {
  std::string text = fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\">\n<Document>\n"
      "<name>{}</name>\n<Folder><name>track</name>\n",
      html_escaped(title));
  for (const auto& line : lines_of(estimates)) {
    text += fmt::format("<Placemark><name>segment {}</name><LineString><coordinates>", estimates[line.front()].segment);
    for (const std::size_t i : line) {
      text += fmt::format("{:.8f},{:.8f} ", estimates[i].position->lon_deg, estimates[i].position->lat_deg);
    }
    text += "</coordinates></LineString></Placemark>\n";
  }
  text += "</Folder>\n<Folder><name>frames</name><visibility>0</visibility>\n";
  for (const Estimate& estimate : estimates) {
    if (!estimate.position) continue;
    text += fmt::format(
        "<Placemark><name>{}</name><description>{}, 1-sigma {:.2f} m</description><Point><coordinates>{:.8f},{:.8f}"
        "</coordinates></Point></Placemark>\n",
        html_escaped(printable(estimate.frame)), name_of(estimate.source), estimate.sigma_m, estimate.position->lon_deg,
        estimate.position->lat_deg);
  }
  return text + "</Folder>\n</Document>\n</kml>\n";
}

std::string gpx_text(std::string_view title, const std::vector<Estimate>& estimates) {
  std::string text = fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<gpx version=\"1.1\" creator=\"Nadir\" "
      "xmlns=\"http://www.topografix.com/GPX/1/1\">\n<trk><name>{}</name>\n",
      html_escaped(title));
  for (const auto& line : lines_of(estimates)) {
    text += "<trkseg>\n";
    for (const std::size_t i : line) {
      text +=
          fmt::format("<trkpt lat=\"{:.8f}\" lon=\"{:.8f}\"><name>{}</name></trkpt>\n", estimates[i].position->lat_deg,
                      estimates[i].position->lon_deg, html_escaped(printable(estimates[i].frame)));
    }
    text += "</trkseg>\n";
  }
  return text + "</trk>\n</gpx>\n";
}

constexpr std::array kFormats{TrackFormat::geojson, TrackFormat::csv, TrackFormat::kml, TrackFormat::gpx,
                              TrackFormat::geo};

}  // namespace

json package_json(const PackageListing& listing) {
  json document{{"name", listing.name}, {"accepted", listing.package != nullptr}};
  if (!listing.package) {
    document["reason"] = printable(listing.reason);
    return document;
  }
  const Manifest& manifest = listing.package->package->manifest();
  const ZoomRange zooms = listing.package->tiles->zooms();
  document["mission"] = printable(manifest.mission_id);
  document["expires"] = to_rfc3339(manifest.expires);
  document["zooms"] = {{"min", zooms.min}, {"max", zooms.max}};
  document["bounds"] = {number(manifest.bounds.west_deg), number(manifest.bounds.south_deg),
                        number(manifest.bounds.east_deg), number(manifest.bounds.north_deg)};
  document["terrain"] = listing.package->surface.has_value();
  return document;
}

json flight_json(const FlightSummary& flight) {
  json document{{"id", flight.id}, {"state", state_of(flight)}};
  const std::string& reason = flight.damaged.empty() ? flight.status.blocked_by : flight.damaged;
  document["reason"] = reason.empty() ? json() : json(printable(reason));
  document["name"] = printable(flight.name);
  document["package"] = flight.package.empty() ? json() : json(printable(flight.package));
  document["created"] = to_rfc3339(flight.created);
  document["pictures"] = {{"accepted", flight.status.accepted}, {"processed", flight.status.processed}};
  document["completion_requested"] = flight.status.completion_requested;
  document["completed"] = flight.status.completed;
  document["completed_share"] = flight.status.completed_share;
  document["diagnosis"] = flight.status.diagnosis.empty() ? json() : json(printable(flight.status.diagnosis));
  return document;
}

json flight_json(const FlightSummary& flight, const FlightStore& store) {
  // First: what happens while the rest is read, a reader of events hears of.
  const std::int64_t last_event = store.last_event();
  json document = flight_json(flight);
  const SessionRecord& session = store.description().session;
  const CameraModel& camera = session.camera.camera;
  document["last_event"] = last_event;
  document["start"] = place(session.start);
  document["camera"] = {{"width", camera.width}, {"height", camera.height}, {"fx", number(camera.fx)}};
  document["integrity_risk"] = number(session.localizer.integrity_risk);
  json kinds = json::array({name_of(EstimateKind::online)});
  for (const EstimateKind kind : {EstimateKind::refined, EstimateKind::adjusted}) {
    if (!store.estimates(kind, 0, 1).empty()) kinds.push_back(name_of(kind));
  }
  document["kinds"] = std::move(kinds);
  return document;
}

json answers_json(std::span<const PictureAnswer> answers) {
  json list = json::array();
  std::size_t accepted = 0, known = 0;
  for (const PictureAnswer& answer : answers) {
    accepted += answer.outcome == PictureAnswer::Outcome::accepted ? 1U : 0U;
    known += answer.outcome == PictureAnswer::Outcome::known ? 1U : 0U;
    json item{{"name", printable(answer.name)}, {"outcome", name_of(answer.outcome)}};
    if (answer.frame) item["frame"] = *answer.frame;
    if (answer.refusal) {
      item["problem"] = name_of(answer.refusal->problem);
      item["reason"] = printable(answer.refusal->reason);
    }
    list.push_back(std::move(item));
  }
  return {{"accepted", accepted},
          {"known", known},
          {"refused", answers.size() - accepted - known},
          {"pictures", std::move(list)}};
}

json estimate_json(std::size_t frame, const Estimate& estimate) {
  json document{{"frame", frame},
                {"name", printable(estimate.frame)},
                {"time_s", number(estimate.time_s)},
                {"source", name_of(estimate.source)},
                {"segment", estimate.segment},
                {"anchor_age_s", number(estimate.anchor_age_s)},
                {"position", nullptr}};
  if (!estimate.position) return document;
  const Eigen::Matrix2d& covariance = estimate.covariance_m2;
  const ErrorEllipse ellipse = error_ellipse(covariance(0, 0), covariance(0, 1), covariance(1, 1));
  json position = place(estimate.position);
  position["sigma_m"] = number(estimate.sigma_m);
  position["hpl_m"] = number(estimate.hpl_m);
  position["ellipse"] = {{"major_m", number(ellipse.major_m)},
                         {"minor_m", number(ellipse.minor_m)},
                         {"bearing_deg", number(ellipse.bearing_deg)}};
  document["position"] = std::move(position);
  return document;
}

json segment_json(const FlightSegment& segment) {
  return {{"segment", segment.number},
          {"first_frame", segment.first_frame},
          {"last_frame", segment.last_frame},
          {"state", name_of(segment.state)},
          {"anchored_frame", segment.anchored_frame ? json(*segment.anchored_frame) : json()}};
}

json look_json(std::size_t frame, const AnchorReport& look, const Bytes& seen, const Bytes& map, bool anew) {
  return {{"frame", frame},
          {"of", anew ? "placement" : "flight"},
          {"verdict", name_of(look.verdict)},
          {"score", number(look.score)},
          {"ratio", number(look.ratio)},
          {"inliers", look.inliers},
          {"patches", look.patches},
          {"residual_px", number(look.residual_px)},
          {"log_likelihood_ratio", number(look.log_likelihood_ratio)},
          {"place_doubt", number(look.place_doubt)},
          {"window_radius_m", number(look.window_radius_m)},
          {"heading_deg", number(degrees(look.heading_rad))},
          {"seen", !seen.empty()},
          {"map", !map.empty()}};
}

std::string event_text(const EventRow& event) {
  json body = json::parse(event.event.body, nullptr, false);
  if (!body.is_object()) body = json::object();
  body["time"] = to_rfc3339(event.time);
  if (event.event.frame) body["frame"] = *event.event.frame;
  return fmt::format("id: {}\nevent: {}\ndata: {}\n\n", event.id, name_of(event.event.kind),
                     body.dump(-1, ' ', false, json::error_handler_t::replace));
}

std::string_view name_of(TrackFormat format) {
  switch (format) {
    case TrackFormat::geojson: return "geojson";
    case TrackFormat::csv: return "csv";
    case TrackFormat::kml: return "kml";
    case TrackFormat::gpx: return "gpx";
    case TrackFormat::geo: return "geo";
  }
  return {};
}

std::string_view ending_of(TrackFormat format) { return format == TrackFormat::geo ? "geo.txt" : name_of(format); }

std::string_view media_type_of(TrackFormat format) {
  switch (format) {
    case TrackFormat::geojson: return "application/geo+json";
    case TrackFormat::csv: return "text/csv; charset=utf-8";
    case TrackFormat::kml: return "application/vnd.google-earth.kml+xml";
    case TrackFormat::gpx: return "application/gpx+xml";
    case TrackFormat::geo: return "text/plain; charset=utf-8";
  }
  return {};
}

std::optional<TrackFormat> parse_track_format(std::string_view name) {
  for (const TrackFormat format : kFormats) {
    if (name_of(format) == name) return format;
  }
  return std::nullopt;
}

std::string track_text(TrackFormat format, std::string_view title, const std::vector<Estimate>& estimates) {
  switch (format) {
    case TrackFormat::geojson: return track_geojson(estimates, {}, {});
    case TrackFormat::csv: return csv_text(estimates);
    case TrackFormat::kml: return kml_text(printable(title), estimates);
    case TrackFormat::gpx: return gpx_text(printable(title), estimates);
    case TrackFormat::geo: return geo_text(estimates);
  }
  return {};
}

}  // namespace nadir
