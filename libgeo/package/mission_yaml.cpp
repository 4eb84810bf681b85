#include "package/mission_yaml.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace nadir {
namespace {

// Numbers in their shortest form that reads back as the same number: what fmt writes for {}.
std::string points_text(const std::vector<LonLat>& points, bool closed) {
  std::string text;
  for (const LonLat& point : points) {
    text += fmt::format("{}[{}, {}]", text.empty() ? "" : ", ", point.lon_deg, point.lat_deg);
  }
  if (closed) text += fmt::format(", [{}, {}]", points.front().lon_deg, points.front().lat_deg);
  return "[" + text + "]";
}

class MissionText {
 public:
  explicit MissionText(const std::set<std::string>& to_check) : to_check_(to_check) {}

  void line(int indent, const std::string& key, const std::string& value) {
    const std::string_view mark = to_check_.contains(key.substr(key.find_first_not_of("- "))) ? "  # check" : "";
    text_ += fmt::format("{:{}}{}: {}{}\n", "", indent, key, value, mark);
  }
  void heading(const std::string& key) { text_ += key + ":\n"; }
  std::string take() { return std::move(text_); }

 private:
  const std::set<std::string>& to_check_;
  std::string text_;
};

}  // namespace

std::string mission_yaml(const Mission& mission, const std::set<std::string>& to_check) {
  MissionText text(to_check);
  const auto number = [](auto value) { return fmt::format("{}", value); };
  const auto quoted = [](const std::string& id) { return "\"" + id + "\""; };
  text.line(0, "schema", std::string(kMissionSchema));
  text.line(0, "id", quoted(mission.id));
  text.line(0, "series", quoted(mission.series));
  text.line(0, "sequence", number(mission.sequence));
  text.line(0, "created", to_rfc3339(mission.created));
  text.line(0, "expires", to_rfc3339(mission.expires));
  text.line(0, "takeoff",
            fmt::format("{{lon_deg: {}, lat_deg: {}}}", mission.takeoff.lon_deg, mission.takeoff.lat_deg));
  text.line(0, "terrain",
            fmt::format("{{mode: {}, height_m: {}}}", mission.terrain.flat ? "flat" : "dem", mission.terrain.height_m));
  text.line(0, "zoom", fmt::format("{{min: {}, max: {}}}", mission.zoom.min, mission.zoom.max));
  text.line(0, "min_resolution_m", number(mission.min_resolution_m));
  text.line(0, "budget_mb", number(mission.budget_mb));
  text.line(0, "freshness_days",
            fmt::format("{{stable: {}, active: {}}}", mission.freshness_days.stable, mission.freshness_days.active));
  text.line(0, "airframes", fmt::format("[{}]", fmt::join(mission.airframes, ", ")));
  if (mission.sectors.empty())
    text.line(0, "sectors", "[]");
  else
    text.heading("sectors");
  for (const Sector& sector : mission.sectors) {
    text.line(2, "- id", quoted(sector.id));
    text.line(4, "class", std::string(name_of(sector.cls)));
    text.line(4, "polygon", points_text(sector.polygon, true));
    if (sector.buffer_m > 0) text.line(4, "buffer_m", number(sector.buffer_m));
  }
  text.heading("route");
  text.line(2, "corridor_half_width_m", number(mission.route.corridor_half_width_m));
  text.line(2, "agl_m", number(mission.route.agl_m));
  text.line(2, "points", points_text(mission.route.points, false));
  if (!mission.route.heights_m.empty()) {
    std::vector<std::string_view> frames;
    for (const HeightFrame frame : mission.route.height_frames) frames.push_back(name_of(frame));
    const std::string frame = frames.empty() ? fmt::format("frame: {}", name_of(mission.route.height_frame))
                                             : fmt::format("frames: [{}]", fmt::join(frames, ", "));
    text.line(2, "heights", fmt::format("{{{}, m: [{}]}}", frame, fmt::join(mission.route.heights_m, ", ")));
  }
  if (!mission.no_fly.empty()) text.heading("no_fly");
  for (const NoFlyArea& area : mission.no_fly) {
    text.line(2, "- id", quoted(area.id));
    if (area.polygon.empty()) {
      text.line(4, "circle",
                fmt::format("{{lon_deg: {}, lat_deg: {}, radius_m: {}}}", area.centre.lon_deg, area.centre.lat_deg,
                            area.radius_m));
    } else {
      text.line(4, "polygon", points_text(area.polygon, true));
    }
  }
  if (mission.integrity != IntegrityRequirement{}) {
    text.heading("integrity");
    text.line(2, "risk", number(mission.integrity.risk));
    text.line(2, "alert_limit_m", number(mission.integrity.alert_limit_m));
    text.line(2, "time_to_alert_s", number(mission.integrity.time_to_alert_s));
  }
  return text.take();
}

}  // namespace nadir
