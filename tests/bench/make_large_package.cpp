// Makes a large package that is valid in every respect except its images: one image, made distinct by a comment of
// the requested size. Measures verification without warping a large set first.
//
//   make_large_package OUT KEY.pem SIDE_KM BYTES_PER_TILE
#include <fmt/format.h>

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <opencv2/core/mat.hpp>

#include "base/files.hpp"
#include "imagery/codecs.hpp"
#include "imagery/mbtiles.hpp"
#include "package/mission_check.hpp"
#include "package/package_writer.hpp"
#include "package/sidecar.hpp"
#include "package/tile_set_check.hpp"

namespace nadir {
namespace {

std::string mission_yaml(double side_km) {
  const double south = 48.0, west = 14.0, north = south + side_km / 111.2, east = west + side_km / (111.2 * 0.669);
  return fmt::format(R"(schema: nadir.mission/1
id: large
series: large
sequence: 1
created: 2025-04-20T00:00:00Z
expires: 2025-12-31T00:00:00Z
takeoff: {{lon_deg: {4:.7f}, lat_deg: {5:.7f}}}
terrain: {{mode: flat}}
zoom: {{min: 15, max: 19}}
min_resolution_m: 0.5
budget_mb: 1000000
freshness_days: {{stable: 730, active: 90}}
airframes: [any]
sectors:
  - id: all
    class: stable
    polygon: [[{0:.7f}, {1:.7f}], [{2:.7f}, {1:.7f}], [{2:.7f}, {3:.7f}], [{0:.7f}, {3:.7f}], [{0:.7f}, {1:.7f}]]
route:
  corridor_half_width_m: 100
  agl_m: 120
  points: [[{4:.7f}, {5:.7f}], [{6:.7f}, {7:.7f}]]
)",
                     west, south, east, north, west + (east - west) / 4, south + (north - south) / 4,
                     east - (east - west) / 4, north - (north - south) / 4);
}

// JPEG comments (marker FFFE) between the start of the image and its first table.
Bytes with_comment(const Bytes& picture, std::size_t size, std::uint64_t number) {
  Bytes tile(picture.begin(), picture.begin() + 2);
  while (tile.size() + picture.size() < size + 2) {
    const std::size_t length = std::min<std::size_t>(size + 2 - tile.size() - picture.size() + 12, 65'535);
    tile.insert(tile.end(), {0xff, 0xfe, static_cast<std::uint8_t>(length >> 8), static_cast<std::uint8_t>(length)});
    for (std::size_t i = 2; i < length; ++i) {
      tile.push_back(static_cast<std::uint8_t>((number * 0x9E3779B97F4A7C15ULL + i * 0xD6E8FEB86659FD93ULL) >> 56));
    }
  }
  tile.insert(tile.end(), picture.begin() + 2, picture.end());
  return tile;
}

void write_tiles(const std::filesystem::path& file, const Mission& mission, std::size_t bytes_per_tile) {
  cv::Mat grey(256, 256, CV_8UC3, cv::Scalar(90, 120, 100));
  const Bytes picture = encode_image(grey, ImageFormat::jpeg);
  MbtilesWriter writer(file);
  std::vector<Sidecar> sidecars;
  for (int zoom = mission.zoom.min; zoom <= mission.zoom.max; ++zoom) {
    for (const TileKey& key : required_tiles(mission, zoom)) {
      const Bytes tile = with_comment(picture, bytes_per_tile, sidecars.size() + 1);
      Sidecar sidecar;
      sidecar.key = key;
      sidecar.sha256 = sha256(tile);
      sidecar.source = "bench";
      sidecar.captured_at = parse_utc("2025-04-01").value();
      sidecar.gsd_mm = 300;
      sidecar.ce90_mm = 4000;
      sidecar.sector = "all";
      sidecars.push_back(std::move(sidecar));
      writer.add(key, tile);
    }
  }
  {
    SidecarWriter table(writer.database());
    for (const Sidecar& sidecar : sidecars) table.add(sidecar);
  }
  writer.set_metadata({{"name", "large"}, {"format", "jpg"}});
  writer.finish();
}

}  // namespace

void make(const std::filesystem::path& package, const PrivateKey& key, double side_km, std::size_t bytes_per_tile) {
  std::filesystem::create_directories(package / "mission");
  std::filesystem::create_directories(package / "imagery");
  write_file_atomic(package / kMissionFile, mission_yaml(side_km));
  const Mission mission = read_mission(package / kMissionFile);
  write_tiles(package / kImageryFile, mission, bytes_per_tile);
  Manifest manifest = manifest_for(mission);
  manifest.artifacts = {describe_file(package, kImageryFile, kRoleImagery),
                        describe_file(package, kMissionFile, kRoleMission)};
  manifest.artifacts[0].tiles = tile_set_facts(package / kImageryFile);
  write_manifest(package, manifest);
  sign_package(package, key);
  fmt::print("{} tiles, {:.2f} GB\n", manifest.artifacts[0].tiles->count,
             static_cast<double>(manifest.artifacts[0].size) / 1e9);
}

}  // namespace nadir

int main(int argc, char** argv) {
  if (argc != 5) return std::fputs("usage: make_large_package OUT KEY.pem SIDE_KM BYTES_PER_TILE\n", stderr), 2;
  try {
    nadir::make(argv[1], nadir::PrivateKey::read(argv[2]), std::atof(argv[3]),
                static_cast<std::size_t>(std::atol(argv[4])));
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "make_large_package: %s\n", error.what()), 2;
  }
  return 0;
}
