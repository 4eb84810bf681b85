// What the tests of update_package() share: ten by ten tiles of zoom 19 whose rasters lie on the tiles' own pixels, so
// that plain arithmetic says which tiles a raster touches.
#pragma once

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "package/sidecar.hpp"
#include "package_build/package_updater.hpp"
#include "raster/test_raster.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::test {

class PackageUpdate : public ::testing::Test {
 protected:
  static constexpr int kZoom = 19, kMinZoom = 14, kTiles = 10;
  static constexpr std::int64_t kColumn = 437'900, kRow = 225'800;  // the north-western tile; four metatiles meet

  PackageUpdate() {
    root_.expires = parse_utc("2030-01-01").value();
    root_.add_key(key_.public_key());
    root_.root.key_ids = root_.package_signer.key_ids = {key_.public_key().id()};
    // Drawing it takes as long as an update: once for the whole suite.
    static const TemporaryFolder drawn;
    if (!std::filesystem::exists(drawn / "old.tif")) {
      write_map(drawn, "old.tif", {0, 0, kTiles * kTileSize, kTiles * kTileSize}, 0, "2024-03-01T00:00:00Z", "archive");
    }
    std::filesystem::copy(drawn.path(), folder_.path());
    write_mission("old.yaml", 1);
    write_mission("new.yaml", 2);
  }

  // pixels: from the north-west corner on. kind: a different image each.
  void write_map(const std::string& name, const cv::Rect& pixels, int kind, const std::string& datetime,
                 const std::string& provider, std::optional<cv::Rect> hole = std::nullopt) {
    write_map(folder_, name, pixels, kind, datetime, provider, hole);
  }
  static void write_map(const TemporaryFolder& folder, const std::string& name, const cv::Rect& pixels, int kind,
                        const std::string& datetime, const std::string& provider,
                        std::optional<cv::Rect> hole = std::nullopt) {
    const double pixel_m = mercator_pixel_m(kZoom), half_m = kPi * kMercatorRadius_m;
    RasterSpec spec;
    spec.epsg = 3857;
    spec.width = pixels.width, spec.height = pixels.height;
    if (hole) spec.nodata = 0;
    spec.transform = {{static_cast<double>(kColumn * kTileSize + pixels.x) * pixel_m - half_m, pixel_m, 0,
                       half_m - static_cast<double>(kRow * kTileSize + pixels.y) * pixel_m, 0, -pixel_m}};
    write_raster(folder / name, spec, [&](int column, int row) -> std::array<int, 4> {
      const int x = column + pixels.x, y = row + pixels.y;
      if (hole && hole->contains({x, y})) return {0, 0, 0, 0};
      const int wave = (x * 7 + y * 3 + kind * 40) % 61, check = (x / 29 + y / 23 + kind) % 2 * 60;
      return {60 + wave + check, 90 + check + kind * 30, 40 + wave + kind * 50, 255};
    });
    write_item(folder / name, datetime, 0.3, provider);
  }

  // first, last: columns of tiles that the only sector covers; rows 3 to 6.
  void write_mission(const std::string& name, int sequence, int first = 3, int last = 6,
                     const std::map<std::string, std::string>& replacements = {}) {
    const auto at = [](double column, double row) {
      const LonLat place = lonlat_from_pixel(
          {(static_cast<double>(kColumn) + column) * kTileSize, (static_cast<double>(kRow) + row) * kTileSize}, kZoom);
      return fmt::format("[{:.8f}, {:.8f}]", place.lon_deg, place.lat_deg);
    };
    const LonLat takeoff = lonlat_from_pixel(
        {static_cast<double>(kColumn + 5) * kTileSize, static_cast<double>(kRow + 5) * kTileSize}, kZoom);
    std::string text =
        fmt::format(R"(schema: nadir.mission/1
id: field
series: field
sequence: {}
created: 2024-10-30T00:00:00Z
expires: 2024-11-30T00:00:00Z
takeoff: {{lon_deg: {:.8f}, lat_deg: {:.8f}}}
terrain: {{mode: flat}}
zoom: {{min: {}, max: {}}}
min_resolution_m: 0.5
budget_mb: 50
freshness_days: {{stable: 730, active: 400}}
airframes: [any]
sectors:
  - id: middle
    class: active
    polygon: [{}, {}, {}, {}, {}]
route:
  corridor_half_width_m: 20
  agl_m: 120
  points: [{}, {}]
)",
                    sequence, takeoff.lon_deg, takeoff.lat_deg, kMinZoom, kZoom, at(first, 3), at(last + 1, 3),
                    at(last + 1, 7), at(first, 7), at(first, 3), at(first + 0.5, 4), at(last + 0.5, 5));
    for (const auto& [from, to] : replacements) {
      ASSERT_NE(text.find(from), std::string::npos) << from;
      text.replace(text.find(from), from.size(), to);
    }
    folder_.write(name, text);
  }

  PackageRequest build_request(const std::string& out, const std::string& mission, std::vector<std::string> maps) {
    PackageRequest request;
    request.mission = folder_ / mission;
    for (const std::string& map : maps) request.imagery.push_back(folder_ / map);
    request.tiles.mosaic.order = MosaicOrder::newest;
    request.tiles.threads = 2;
    request.key = &key_;
    request.out = folder_ / out;
    return request;
  }
  PackageReport build(const std::string& out, const std::string& mission, std::vector<std::string> maps,
                      ImageFormat format = ImageFormat::jpeg) {
    PackageRequest request = build_request(out, mission, std::move(maps));
    request.tiles.encoding.format = format;
    NoProgress progress;
    return build_package(request, progress);
  }

  // The package "old" of old.tif and old.yaml as they are at first; built once for the whole suite.
  void build_old() {
    static const TemporaryFolder built;
    if (!std::filesystem::exists(built / "old")) {
      ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.has_errors());
      std::filesystem::copy(folder_ / "old", built / "old", std::filesystem::copy_options::recursive);
      return;
    }
    std::filesystem::copy(built / "old", folder_ / "old", std::filesystem::copy_options::recursive);
  }

  UpdateRequest request(std::vector<std::string> maps, const std::string& out = "new") {
    UpdateRequest request;
    request.old_package = folder_ / "old";
    request.trust = &root_;
    request.mission = folder_ / "new.yaml";
    for (const std::string& map : maps) request.imagery.push_back(folder_ / map);
    request.tiles.mosaic.order = MosaicOrder::newest;
    request.tiles.threads = 2;
    request.key = &key_;
    request.out = folder_ / out;
    request.on_remark = [this](std::string_view remark) { remarks_.emplace_back(remark); };
    return request;
  }
  UpdateReport update(const UpdateRequest& request) {
    NoProgress progress;
    return update_package(request, progress);
  }
  void expect_refused(const UpdateRequest& request, std::string_view code) {
    const UpdateReport report = update(request);
    EXPECT_TRUE(report.package.findings.contains(code)) << code;
    EXPECT_TRUE(report.package.findings.has_errors());
    EXPECT_FALSE(std::filesystem::exists(request.out));
    EXPECT_FALSE(std::filesystem::exists(folder_ / ("." + request.out.filename().string() + ".staging")));
  }

  // By arithmetic: tiles of every zoom that hold one of the pixels.
  static std::set<TileKey> touched_by(const cv::Rect& pixels) {
    std::set<TileKey> keys;
    for (int zoom = kMinZoom; zoom <= kZoom; ++zoom) {
      const std::int64_t side = std::int64_t{kTileSize} << (kZoom - zoom);
      const std::int64_t x = kColumn * kTileSize + pixels.x, y = kRow * kTileSize + pixels.y;
      for (std::int64_t column = x / side; column <= (x + pixels.width - 1) / side; ++column) {
        for (std::int64_t row = y / side; row <= (y + pixels.height - 1) / side; ++row) {
          keys.insert(
              {static_cast<std::uint8_t>(zoom), static_cast<std::uint32_t>(column), static_cast<std::uint32_t>(row)});
        }
      }
    }
    return keys;
  }

  std::vector<Sidecar> sidecars(const std::string& package) const {
    const SqliteDatabase database = SqliteDatabase::open_immutable(folder_ / package / kImageryFile);
    return read_sidecars(database).sidecars;
  }
  static void expect_same_files(const std::filesystem::path& a, const std::filesystem::path& b) {
    const auto result = run_process({"diff", "-r", a.string(), b.string()});
    EXPECT_EQ(result.code, 0) << result.out;
  }

  TemporaryFolder folder_;
  static const PrivateKey& suite_key() {
    static const PrivateKey key = PrivateKey::generate();
    return key;
  }
  const PrivateKey& key_ = suite_key();
  TrustRoot root_;
  std::vector<std::string> remarks_;
};

}  // namespace nadir::test
