#include "package_build/package_builder_fixture.hpp"

#include <fmt/format.h>

#include <csignal>

namespace nadir::test {

namespace fs = std::filesystem;

PackageBuilder::PackageBuilder() {
  spec_.width = spec_.height = 1600;
  const auto& t = *spec_.transform;
  const auto corner = [&](double column, double row) {
    const auto place = project(32651, "EPSG:4326", {t[0] + t[1] * column, t[3] + t[5] * row});
    return fmt::format("[{:.7f}, {:.7f}]", place.x, place.y);
  };
  polygon_ = fmt::format("[{0}, {1}, {2}, {3}, {0}]", corner(467, 467), corner(1133, 467), corner(1133, 1133),
                         corner(467, 1133));
  const auto centre = project(32651, "EPSG:4326", {t[0] + 240, t[3] - 240});
  takeoff_ = fmt::format("{{lon_deg: {:.7f}, lat_deg: {:.7f}}}", centre.x, centre.y);
  route_ = fmt::format("[{}, {}]", corner(700, 700), corner(900, 850));
  write_mission();
  write_map("map.tif");
}

void PackageBuilder::write_mission(int active_days, int budget_mb) {
  folder_.write("mission.yaml", fmt::format(R"(schema: nadir.mission/1
id: field
series: field
sequence: 1
created: 2024-10-30T00:00:00Z
expires: 2024-11-30T00:00:00Z
takeoff: {}
terrain: {{mode: flat}}
zoom: {{min: 14, max: 19}}
min_resolution_m: 0.5
budget_mb: {}
freshness_days: {{stable: 730, active: {}}}
airframes: [any]
sectors:
  - id: middle
    class: active
    polygon: {}
route:
  corridor_half_width_m: 20
  agl_m: 120
  points: {}
)",
                                            takeoff_, budget_mb, active_days, polygon_, route_));
}

void PackageBuilder::write_map(const std::string& name, std::array<int, 3> light) {
  write_raster(folder_ / name, spec_, [&](int column, int row) -> std::array<int, 4> {
    if (hole_ && hole_(column, row)) return {0, 0, 0, 0};
    const bool bright = (column / 27 + row / 27) % 2 == 0;
    if (bright) return {light[0], light[1], light[2], 255};
    return {90, 120, 70, 255};
  });
  write_item(folder_ / name);
}

PackageRequest PackageBuilder::request(const std::string& out, int threads) {
  PackageRequest request;
  request.mission = folder_ / "mission.yaml";
  request.imagery = {folder_ / "map.tif"};
  request.tiles.threads = threads;
  request.key = &key_;
  request.out = folder_ / out;
  return request;
}

PackageReport PackageBuilder::build(const PackageRequest& request) {
  NoProgress progress;
  return build_package(request, progress);
}

std::vector<std::string> PackageBuilder::left_behind() const {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder_.path())) {
    const std::string name = entry.path().filename();
    if (name.starts_with("map") || name.starts_with("old") || name == "mission.yaml") continue;
    names.push_back(name);
  }
  return names;
}

void PackageBuilder::expect_refused(const PackageRequest& request, std::string_view code) {
  const PackageReport report = build(request);
  EXPECT_TRUE(report.findings.has_errors());
  EXPECT_TRUE(report.findings.contains(code)) << code;
  EXPECT_THAT(left_behind(), testing::IsEmpty());
}

void PackageBuilder::expect_same_files(const fs::path& a, const fs::path& b) {
  const auto result = run_process({"diff", "-r", a.string(), b.string()});
  EXPECT_EQ(result.code, 0) << result.out;
}

ProcessResult PackageBuilder::run_build(const PackageRequest& wanted, int event, const std::string& uid) {
  std::vector<std::string> args{NADIR_KILLED_BUILD,
                                wanted.mission,
                                wanted.imagery.front(),
                                folder_ / "map.key.pem",
                                wanted.out,
                                std::to_string(wanted.tiles.threads),
                                wanted.resume ? "resume" : "fresh",
                                wanted.tiles.container == TileSetKind::cog ? "cog" : "mbtiles",
                                std::to_string(event)};
  if (!uid.empty()) args.push_back(uid);
  return run_process(args);
}

void PackageBuilder::build_and_kill(const PackageRequest& wanted, int event) {
  const auto result = run_build(wanted, event);
  ASSERT_EQ(result.code, 128 + SIGKILL) << result.err;
}

}  // namespace nadir::test
