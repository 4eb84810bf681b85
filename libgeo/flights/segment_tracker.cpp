#include "flights/segment_tracker.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

// A person is asked when a third look finds nothing: two failures in a row are common over changed ground.
constexpr int kFailuresBeforeHelp = 3;
// A window grows a little with every frame; it is worth telling when a quarter more is searched.
constexpr double kExpandedBy = 1.12;

constexpr std::size_t kCandidatesShown = 5;  // that a person compares
constexpr double kCandidateReach_m = 50;     // of one that is chosen

constexpr std::array kKinds{
    FlightEventKind::flight_created,    FlightEventKind::pictures_accepted, FlightEventKind::frame_processed,
    FlightEventKind::frame_refined,     FlightEventKind::search_expanded,   FlightEventKind::segment_started,
    FlightEventKind::segment_anchored,  FlightEventKind::segments_merged,   FlightEventKind::merge_withdrawn,
    FlightEventKind::user_input_needed, FlightEventKind::user_fix,          FlightEventKind::fix_withdrawn,
    FlightEventKind::objects_changed,   FlightEventKind::diagnosis_changed, FlightEventKind::processing_blocked,
    FlightEventKind::flight_completed};

StoredFlightEvent event(FlightEventKind kind, std::size_t frame, const nlohmann::json& body) {
  return {kind, frame, body.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
}

// JSON has no infinity and no NaN.
nlohmann::json number(double value) { return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr); }

nlohmann::json processed_body(const FrameReport& report) {
  const Estimate& estimate = report.estimate;
  nlohmann::json body{{"name", estimate.frame},
                      {"time_s", number(estimate.time_s)},
                      {"source", name_of(estimate.source)},
                      {"segment", estimate.segment},
                      {"verdict", name_of(report.anchor.verdict)}};
  if (estimate.position) {
    body["lat_deg"] = number(estimate.position->lat_deg);
    body["lon_deg"] = number(estimate.position->lon_deg);
    body["sigma_m"] = number(estimate.sigma_m);
    body["cov_ee_m2"] = number(estimate.covariance_m2(0, 0));
    body["cov_en_m2"] = number(estimate.covariance_m2(0, 1));
    body["cov_nn_m2"] = number(estimate.covariance_m2(1, 1));
    if (estimate.hpl_m) body["hpl_m"] = number(*estimate.hpl_m);
  }
  return body;
}

// The places that look most like the frame, wherever it was searched.
nlohmann::json candidates(const AnchorReport& look, const LocalFrame& plane) {
  nlohmann::json list = nlohmann::json::array();
  for (const MatchHypothesis& place : look.places) {
    if (list.size() == kCandidatesShown) break;
    const LonLat at = plane.lonlat_from_plane(place.pose.position);
    list.push_back({{"lat_deg", number(at.lat_deg)},
                    {"lon_deg", number(at.lon_deg)},
                    {"heading_deg", number(degrees(place.pose.attitude.heading_rad))},
                    {"likeness", number(std::clamp(place.score, 0.0, 1.0))},
                    {"radius_m", kCandidateReach_m}});
  }
  return list;
}

}  // namespace

std::string_view name_of(SegmentState state) {
  switch (state) {
    case SegmentState::floating: return "floating";
    case SegmentState::anchored: return "anchored";
    case SegmentState::merged: return "merged";
  }
  return {};
}

std::string_view name_of(FlightEventKind kind) {
  switch (kind) {
    case FlightEventKind::flight_created: return "flight_created";
    case FlightEventKind::pictures_accepted: return "pictures_accepted";
    case FlightEventKind::frame_processed: return "frame_processed";
    case FlightEventKind::frame_refined: return "frame_refined";
    case FlightEventKind::search_expanded: return "search_expanded";
    case FlightEventKind::segment_started: return "segment_started";
    case FlightEventKind::segment_anchored: return "segment_anchored";
    case FlightEventKind::segments_merged: return "segments_merged";
    case FlightEventKind::merge_withdrawn: return "merge_withdrawn";
    case FlightEventKind::user_input_needed: return "user_input_needed";
    case FlightEventKind::user_fix: return "user_fix";
    case FlightEventKind::fix_withdrawn: return "fix_withdrawn";
    case FlightEventKind::objects_changed: return "objects_changed";
    case FlightEventKind::diagnosis_changed: return "diagnosis_changed";
    case FlightEventKind::processing_blocked: return "processing_blocked";
    case FlightEventKind::flight_completed: return "flight_completed";
  }
  return {};
}

std::optional<FlightEventKind> parse_flight_event(std::string_view name) {
  for (const FlightEventKind kind : kKinds) {
    if (name_of(kind) == name) return kind;
  }
  return std::nullopt;
}

SegmentTracker::Changes SegmentTracker::on_frame(const FrameReport& report) {
  Changes changes;
  const std::size_t frame = frame_++;
  const AnchorReport& look = report.anchor;
  const int number = report.estimate.segment;
  const auto [found, started] =
      segments_.try_emplace(number, FlightSegment{.number = number, .first_frame = frame, .last_frame = frame});
  FlightSegment& segment = found->second;
  if (started) changes.events.push_back(event(FlightEventKind::segment_started, frame, {{"segment", number}}));
  segment.last_frame = frame;
  changes.events.push_back(event(FlightEventKind::frame_processed, frame, processed_body(report)));

  const bool looked = look.verdict != AnchorVerdict::not_tried && look.verdict != AnchorVerdict::frame_unfit;
  if (look.verdict == AnchorVerdict::accepted) {
    failed_looks_ = 0;
    if (segment.state == SegmentState::floating) {
      segment.state = SegmentState::anchored;
      segment.anchored_frame = frame;
      changes.events.push_back(event(FlightEventKind::segment_anchored, frame, {{"segment", number}}));
    }
  } else if (looked && look.verdict != AnchorVerdict::awaiting_votes) {  // which found a place, if not for certain
    ++failed_looks_;
    if (failed_looks_ == 1) announced_window_m_ = look.window_radius_m;
    if (look.window_radius_m > kExpandedBy * announced_window_m_) {
      changes.events.push_back(
          event(FlightEventKind::search_expanded, frame,
                {{"from_m", announced_window_m_}, {"to_m", look.window_radius_m}, {"failed_looks", failed_looks_}}));
      announced_window_m_ = look.window_radius_m;
    }
    if (failed_looks_ == kFailuresBeforeHelp) {
      nlohmann::json body{{"segment", number}, {"failed_looks", failed_looks_}, {"verdict", name_of(look.verdict)}};
      if (plane_ && !look.places.empty()) body["candidates"] = candidates(look, *plane_);
      changes.events.push_back(event(FlightEventKind::user_input_needed, frame, body));
    }
  }
  changes.segments.push_back(segment);
  return changes;
}

}  // namespace nadir
