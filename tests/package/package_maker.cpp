#include "package/package_maker.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "imagery/codecs.hpp"
#include "imagery/cog_writer.hpp"
#include "imagery/mbtiles.hpp"
#include "package/mission_check.hpp"
#include "package/package_writer.hpp"
#include "package/sidecar.hpp"

namespace nadir::test {

std::string mission_yaml(const std::map<std::string, std::string>& replacements) {
  std::string yaml = R"(schema: nadir.mission/1
id: village-a
series: village
sequence: 3
created: 2024-04-20T00:00:00Z
expires: 2024-06-01T00:00:00Z
takeoff: {lon_deg: 11.0000, lat_deg: 48.0000}
terrain: {mode: flat}
zoom: {min: 17, max: 18}
min_resolution_m: 0.5
budget_mb: 20
freshness_days: {stable: 730, active: 90}
airframes: [mini-07, mini-08]
sectors:
  - id: village
    class: stable
    polygon: [[10.9990, 47.9990], [11.0010, 47.9990], [11.0010, 48.0010], [10.9990, 48.0010], [10.9990, 47.9990]]
route:
  corridor_half_width_m: 40
  agl_m: 120
  points: [[11.0000, 48.0000], [11.0040, 48.0005]]
)";
  for (const auto& [from, to] : replacements) {
    const std::size_t at = yaml.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    if (at != std::string::npos) yaml.replace(at, from.size(), to);
  }
  return yaml;
}

namespace {

void write_as_mbtiles(const std::filesystem::path& package, const std::map<TileKey, Bytes>& tiles,
                      const std::vector<Sidecar>& sidecars, const std::map<std::string, std::string>& metadata) {
  MbtilesWriter writer(package / kImageryFile);
  for (const auto& [key, tile] : tiles) writer.add(key, tile);
  {
    SidecarWriter table(writer.database());
    for (const Sidecar& sidecar : sidecars) table.add(sidecar);
  }
  writer.set_metadata(metadata);
  writer.finish();
}

void write_as_cog(const std::filesystem::path& package, ZoomRange zooms, const std::map<TileKey, Bytes>& tiles) {
  std::uint32_t west = ~0U, north = ~0U, east = 0, south = 0;
  for (const auto& [key, tile] : tiles) {
    const int steps = key.z - zooms.min;
    west = std::min(west, key.x >> steps), east = std::max(east, key.x >> steps);
    north = std::min(north, key.y >> steps), south = std::max(south, key.y >> steps);
  }
  CogWriter writer(package / kCogFile, {zooms, west, north, east - west + 1, south - north + 1}, ImageFormat::jpeg);
  for (const auto& [key, tile] : tiles) writer.add(key, tile);
  writer.finish();
}

}  // namespace

Bytes noise_tile(std::uint64_t seed, int side) {
  Random random(seed);
  cv::Mat image(side, side, CV_8UC3);
  for (auto* value = image.datastart; value != image.dataend; ++value) {
    image.data[value - image.datastart] = static_cast<std::uint8_t>(random.integer(0, 255));
  }
  return encode_image(image, ImageFormat::jpeg, 60);
}

PackageMaker::PackageMaker() {
  root.expires = parse_utc("2030-01-01").value();
  root.add_key(signer.public_key());
  root.package_signer.key_ids = {signer.public_key().id()};
  root.root.key_ids = {signer.public_key().id()};
}

std::filesystem::path PackageMaker::make(const TemporaryFolder& folder, const std::string& name) const {
  const std::filesystem::path package = folder / name;
  std::filesystem::create_directories(package / "mission");
  std::filesystem::create_directories(package / "imagery");
  write_file_atomic(package / kMissionFile, mission);
  const Mission parsed = read_mission(package / kMissionFile);
  std::map<TileKey, Bytes> tiles;
  std::vector<Sidecar> sidecars;
  for (int zoom = parsed.zoom.min; zoom <= parsed.zoom.max; ++zoom) {
    for (const TileKey& key : required_tiles(parsed, zoom)) {
      Bytes tile = noise_tile(key.x * 1000 + key.y);
      Sidecar sidecar;
      sidecar.key = key;
      sidecar.source = "test";
      sidecar.captured_at = parse_utc("2024-04-01").value();
      sidecar.gsd_mm = 300;
      sidecar.ce90_mm = 4000;
      sidecar.sector = "village";
      if (!edit_tile(sidecar, tile)) continue;
      sidecar.sha256 = sha256(tile);
      sidecars.push_back(sidecar);
      tiles[key] = std::move(tile);
    }
  }
  const std::map<std::string, std::string> metadata{{"name", "test"}, {"format", "jpg"}};
  if (cog) {
    write_as_cog(package, parsed.zoom, tiles);
    write_sidecar_file(package / kSidecarFile, sidecars, metadata);
  } else {
    write_as_mbtiles(package, tiles, sidecars, metadata);
  }
  Manifest manifest = manifest_for(parsed);
  manifest.artifacts = {describe_file(package, imagery_file(), kRoleImagery),
                        describe_file(package, kMissionFile, kRoleMission)};
  if (cog) manifest.artifacts.push_back(describe_file(package, kSidecarFile, kRoleSidecars));
  try {
    manifest.artifacts[0].tiles = tile_set_facts(package / imagery_file());
  } catch (const Error&) {  // the test damaged the tiles: no facts can be read from them
    TileSetFacts facts;
    facts.zoom = parsed.zoom;
    facts.format = "jpeg";
    manifest.artifacts[0].tiles = facts;
  }
  edit_manifest(manifest);
  std::string bytes = manifest_json(manifest);
  edit_bytes(bytes);
  write_file_atomic(package / kManifestFile, bytes);
  sign(package);
  return package;
}

void PackageMaker::sign(const std::filesystem::path& package) const { sign_package(package, signer); }

VerifyOptions PackageMaker::options(VerifyDepth depth) const {
  return {.root = &root, .depth = depth, .at = kJudged, .airframe = std::nullopt, .state = nullptr, .permit = nullptr};
}

Verification PackageMaker::verify(const std::filesystem::path& package, VerifyDepth depth) const {
  NoProgress progress;
  return verify_package(package, options(depth), progress);
}

void sqlite(const std::filesystem::path& database, const std::string& sql) {
  const std::string command = "sqlite3 '" + database.string() + "' \"" + sql + "\"";
  ASSERT_EQ(std::system(command.c_str()), 0) << sql;
}

std::string codes(const Findings& findings) {
  std::string text;
  for (const Finding& finding : findings.items()) text += (text.empty() ? "" : ", ") + finding.code;
  return text;
}

}  // namespace nadir::test
