// Which reader and which writer a file needs.
#include "mission_formats/mission_files.hpp"

#include <array>

#include "base/files.hpp"
#include "base/input_file.hpp"
#include "mission_formats/gis_files.hpp"
#include "mission_formats/mavlink_plans.hpp"

namespace nadir {
namespace {

constexpr std::uint64_t kMaxPlan_bytes = std::uint64_t{32} << 20;

std::string first_bytes(const std::filesystem::path& path) {
  std::array<std::uint8_t, 16> head{};
  const InputFile input(path);
  const std::size_t size = std::min<std::uint64_t>(head.size(), input.size());
  if (!input.read_at(0, std::span(head).first(size))) return {};
  return {reinterpret_cast<const char*>(head.data()), size};
}

}  // namespace

MissionDrawing read_mission_drawing(const std::filesystem::path& path, bool latitude_first) {
  if (!std::filesystem::is_regular_file(path)) {
    throw UsageError({.what = "no such file", .where = path.string(), .fix = "check the path"});
  }
  const std::string head = first_bytes(path);
  if (head.starts_with("SQLite format 3") || head.empty()) return read_gis_drawing(path, latitude_first);
  if (head.starts_with("PK\x03\x04")) return read_kml_drawing(kml_of_archive(path), path.string(), latitude_first);
  if (is_waypoint_file(head)) return read_waypoints(read_text_file(path, kMaxPlan_bytes), path.string());
  const std::size_t start = head.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  const char first = start == std::string::npos ? ' ' : head[start];
  if (first == '{') {
    const std::string text = read_text_file(path, kMaxDrawing_bytes);
    if (is_plan(text)) return read_plan(text, path.string());
  }
  if (first == '<') {
    const std::string text = read_text_file(path, kMaxDrawing_bytes);
    if (text.find("<kml") != std::string::npos || text.find(":kml") != std::string::npos) {
      return read_kml_drawing(text, path.string(), latitude_first);
    }
  }
  return read_gis_drawing(path, latitude_first);
}

std::optional<MissionFormat> mission_format_of(std::string_view name) {
  for (const MissionFormat format : kMissionFormats) {
    if (name == name_of(format)) return format;
  }
  return std::nullopt;
}

std::string_view name_of(MissionFormat format) {
  switch (format) {
    case MissionFormat::kml: return "kml";
    case MissionFormat::kmz: return "kmz";
    case MissionFormat::geojson: return "geojson";
    case MissionFormat::gpkg: return "gpkg";
    case MissionFormat::plan: return "plan";
    case MissionFormat::waypoints: return "waypoints";
  }
  return "geojson";
}

std::vector<std::string> write_mission_as(const Mission& mission, MissionFormat format,
                                          const std::filesystem::path& path) {
  std::vector<std::string> left_out;
  switch (format) {
    case MissionFormat::kml: write_file_atomic(path, mission_as_kml(mission)); break;
    case MissionFormat::kmz: write_file_atomic(path, mission_as_kmz(mission)); break;
    case MissionFormat::geojson: write_file_atomic(path, mission_as_geojson(mission)); break;
    case MissionFormat::gpkg: write_mission_geopackage(mission, path); break;
    case MissionFormat::plan: write_file_atomic(path, mission_as_plan(mission)); break;
    case MissionFormat::waypoints:
      write_file_atomic(path, mission_as_waypoints(mission));
      left_out = {"everything but the take-off point and the route: import it with --mission"};
      break;
  }
  return left_out;
}

}  // namespace nadir
