#include "package/mission.hpp"

#include <algorithm>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {

std::string_view name_of(SectorClass cls) { return cls == SectorClass::stable ? "stable" : "active"; }

bool Mission::allows(std::string_view airframe) const {
  return std::any_of(airframes.begin(), airframes.end(),
                     [airframe](const std::string& allowed) { return allowed == kAnyAirframe || allowed == airframe; });
}

MissionReading check_mission(const std::filesystem::path& path) {
  return parse_mission(read_text_file(path, std::uint64_t{1} << 20), path.string());
}

Mission read_mission(const std::filesystem::path& path) {
  MissionReading reading = check_mission(path);
  if (reading.mission) return std::move(*reading.mission);
  const Finding& first = reading.findings.items().front();
  const std::size_t more = reading.findings.items().size() - 1;
  throw UsageError(
      {.what = "the mission file is not valid",
       .where = first.where,
       .expected = first.expected,
       .found = first.found,
       .fix = more == 0 ? first.fix : "`nadir mission check` shows this and " + std::to_string(more) + " more"});
}

LocalFrame mission_frame(const Mission& mission) { return LocalFrame(mission.takeoff, mission.terrain.height_m); }

Region required_region(const Mission& mission, const LocalFrame& frame) {
  Region region;
  for (const Sector& sector : mission.sectors) region.rings.push_back(to_plane(frame, sector.polygon));
  if (!mission.route.points.empty()) {
    region.corridors.push_back({to_plane(frame, mission.route.points), mission.route.corridor_half_width_m});
  }
  return region;
}

}  // namespace nadir
