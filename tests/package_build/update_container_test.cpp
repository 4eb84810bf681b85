// Updates of packages in COGs and from one container to the other, against whole builds.
#include <csignal>
#include <fstream>

#include "base/error.hpp"
#include "imagery/cog_reader.hpp"
#include "imagery/lossless_webp.hpp"
#include "package/amend_package.hpp"
#include "package/tile_container.hpp"
#include "package/verify.hpp"
#include "package_build/package_builder.hpp"
#include "package_build/update_fixture.hpp"
#include "vision/place_index_builder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::PackageUpdate;

constexpr TileEncoding kJpeg{}, kLossless{ImageFormat::webp, 75, true};

class UpdateOfCogs : public PackageUpdate {
 protected:
  UpdateOfCogs() { write_map("patch.tif", {700, 900, 900, 500}, 1, "2024-09-01T00:00:00Z", "survey"); }

  void make(const std::string& out, const std::string& mission, std::vector<std::string> maps, TileSetKind container,
            TileEncoding encoding) {
    PackageRequest wanted = build_request(out, mission, std::move(maps));
    wanted.tiles.container = container;
    wanted.tiles.encoding = encoding;
    NoProgress progress;
    ASSERT_FALSE(build_package(wanted, progress).findings.refuses());
  }
  void add_index(const std::string& name) {
    const fs::path package = folder_ / name;
    const Manifest manifest = read_package_manifest(package);
    const Mission mission = read_mission(package / kMissionFile);
    const auto source = open_tile_source(tiles_of(name));
    IndexedMap map{source.get(), {}, manifest.artifact(kRoleImagery)->tiles->merkle_root, mission.takeoff};
    for (const Sidecar& tile : sidecars(name)) {
      if (tile.key.z == kZoom) map.keys.push_back(tile.key);
    }
    PlaceIndexOptions options;
    options.footprints_m = {150};
    options.overlap_percent = 25;
    NoProgress progress;
    const PlaceIndex index = build_place_index(map, options, progress);
    const Amendment amendment{{}, [&](const fs::path& folder) { return write_place_index(folder, index); }};
    ASSERT_TRUE(amend_package(package, manifest, mission, amendment, &key_, progress).findings.empty());
  }
  fs::path tiles_of(const std::string& package) const {
    const fs::path cog = folder_ / package / kCogFile;
    return fs::exists(cog) ? cog : folder_ / package / kImageryFile;
  }
};

class FromOneContainerToAnother : public UpdateOfCogs,
                                  public testing::WithParamInterface<std::pair<TileSetKind, TileSetKind>> {
 protected:
  TileSetKind before() const { return GetParam().first; }
  TileSetKind after() const { return GetParam().second; }
  UpdateRequest wanted(std::vector<std::string> maps) {
    UpdateRequest wanted = request(std::move(maps));
    if (before() != after()) wanted.container = after();  // else: that of the old package
    return wanted;
  }
};

// Only the mission changes: every tile is copied, and the package is the one that a build would make.
TEST_P(FromOneContainerToAnother, WithoutChangesItIsTheBuildByteForByte) {
  make("old", "old.yaml", {"old.tif"}, before(), kJpeg);
  const UpdateReport report = update(wanted({}));
  ASSERT_FALSE(report.package.findings.refuses());
  EXPECT_EQ(report.counts.copied, report.package.tiles);
  make("whole", "new.yaml", {"old.tif"}, after(), kJpeg);
  expect_same_files(folder_ / "new", folder_ / "whole");
}

// Without loss there is no difference at all between updating and building from everything.
TEST_P(FromOneContainerToAnother, WithLosslessTilesItIsTheBuildFromBothByteForByte) {
  // 6 x 6 tiles: encoding without loss takes its time.
  write_map("old.tif", {512, 512, 1536, 1536}, 0, "2024-03-01T00:00:00Z", "archive", cv::Rect(550, 600, 150, 500));
  make("old", "old.yaml", {"old.tif"}, before(), kLossless);
  const UpdateReport report = update(wanted({"patch.tif"}));
  ASSERT_FALSE(report.package.findings.refuses());
  EXPECT_GT(report.counts.reencoded, 20U);
  EXPECT_GT(report.counts.copied, 10U);
  make("both", "new.yaml", {"old.tif", "patch.tif"}, after(), kLossless);
  expect_same_files(folder_ / "new", folder_ / "both");
  const auto container = open_tile_container(tiles_of("new"));
  for (const auto tiles = container->tiles(true); tiles->next();) {
    ASSERT_TRUE(is_lossless_webp(tiles->bytes())) << tiles->address();
  }
  NoProgress progress;
  VerifyOptions options;
  options.root = &root_;
  options.depth = VerifyDepth::full;
  options.at = parse_utc("2024-11-01").value();
  EXPECT_TRUE(verify_package(folder_ / "new", options, progress).findings.empty());
}

std::string name_of(const testing::TestParamInfo<std::pair<TileSetKind, TileSetKind>>& info) {
  const auto name = [](TileSetKind kind) { return std::string(kind == TileSetKind::cog ? "Cog" : "Mbtiles"); };
  return name(info.param.first) + "To" + name(info.param.second);
}

INSTANTIATE_TEST_SUITE_P(All, FromOneContainerToAnother,
                         testing::Values(std::pair{TileSetKind::cog, TileSetKind::cog},
                                         std::pair{TileSetKind::cog, TileSetKind::mbtiles},
                                         std::pair{TileSetKind::mbtiles, TileSetKind::cog}),
                         name_of);

// There and back: what leaves a container is what came into it.
TEST_F(UpdateOfCogs, ThereAndBackIsTheSamePackage) {
  make("old", "old.yaml", {"old.tif"}, TileSetKind::mbtiles, kJpeg);
  UpdateRequest there = request({"patch.tif"});
  there.container = TileSetKind::cog;
  ASSERT_FALSE(update(there).package.findings.refuses());
  ASSERT_FALSE(update(request({"patch.tif"}, "straight")).package.findings.refuses());
  write_mission("third.yaml", 3);
  for (const auto& [from, to] : {std::pair{"new", "back"}, {"straight", "third"}}) {
    UpdateRequest next = request({}, to);
    next.old_package = folder_ / from;
    next.mission = folder_ / "third.yaml";
    next.container = TileSetKind::mbtiles;
    ASSERT_FALSE(update(next).package.findings.refuses());
  }
  expect_same_files(folder_ / "back", folder_ / "third");
}

TEST_F(UpdateOfCogs, SameBytesForAnyNumberOfThreads) {
  make("old", "old.yaml", {"old.tif"}, TileSetKind::cog, kJpeg);
  for (const int threads : {1, 3}) {
    UpdateRequest wanted = request({"patch.tif"}, "new" + std::to_string(threads));
    wanted.tiles.threads = threads;
    ASSERT_FALSE(update(wanted).package.findings.refuses());
  }
  expect_same_files(folder_ / "new1", folder_ / "new3");
}

TEST_F(UpdateOfCogs, PngTilesCannotGoThereAsTheyAre) {
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}, ImageFormat::png).findings.refuses());
  UpdateRequest wanted = request({"patch.tif"});
  wanted.container = TileSetKind::cog;
  try {
    update(wanted);
    ADD_FAILURE() << "PNG in a COG";
  } catch (const UsageError& error) {
    EXPECT_THAT(error.text().fix, testing::HasSubstr("--format"));
  }
  EXPECT_FALSE(fs::exists(folder_ / "new"));
  EXPECT_FALSE(fs::exists(folder_ / ".new.staging"));
}

// Quick verification does not see it; whoever copies the tile, or lays imagery upon it, does.
TEST_F(UpdateOfCogs, ADamagedTileIsNotTakenOver) {
  make("old", "old.yaml", {"old.tif"}, TileSetKind::cog, kJpeg);
  const CogReader reader(folder_ / "old" / kCogFile);
  const CogLevel& finest = *reader.level(kZoom);
  const auto spoil = [&](std::uint32_t column, std::uint32_t row) {
    const auto at = static_cast<std::size_t>((kRow + row - finest.north / kTileSize) * finest.image.across + kColumn +
                                             column - finest.west / kTileSize);
    ASSERT_GT(finest.image.sizes[at], 0U);
    std::fstream file(folder_ / "old" / kCogFile, std::ios::binary | std::ios::in | std::ios::out);
    file.seekg(static_cast<std::streamoff>(finest.image.places[at] + finest.image.sizes[at] / 2));
    const int byte = file.peek();
    file.seekp(file.tellg());
    file.put(static_cast<char>(byte ^ 1));
  };
  spoil(4, 4);  // under the patch
  expect_refused(request({"patch.tif"}), "artifact.hash");
  spoil(4, 4);  // back to what it was
  ASSERT_FALSE(update(request({"patch.tif"}, "sound")).package.findings.refuses());
  spoil(0, 0);
  for (const auto container : {TileSetKind::cog, TileSetKind::mbtiles}) {
    UpdateRequest wanted = request({"patch.tif"});
    wanted.container = container;
    expect_refused(wanted, "artifact.hash");
  }
}

// While tiles are copied, while the index is made anew, while everything is put together.
TEST_F(UpdateOfCogs, AKilledUpdateLeavesNothingAndTheNextOneWorks) {
  make("old", "old.yaml", {"old.tif"}, TileSetKind::mbtiles, kJpeg);
  add_index("old");
  folder_.write("root.json", sign_root(root_, {&key_}).json());
  write_file_atomic(folder_ / "k.pem", key_.pem(), 0600);
  const auto run = [&](const std::string& out, int event) {
    return test::run_process({NADIR_KILLED_UPDATE, folder_ / "old", folder_ / "root.json", folder_ / "new.yaml",
                              folder_ / "patch.tif", folder_ / "k.pem", folder_ / out, std::to_string(event), "cog",
                              "index"});
  };
  const auto whole = run("whole", 0);
  ASSERT_EQ(whole.code, 0) << whole.err;
  EXPECT_TRUE(fs::exists(folder_ / "whole" / kCogFile));
  EXPECT_TRUE(fs::exists(folder_ / "whole" / kPlaceIndexFile));
  const int events = std::stoi(whole.out);
  ASSERT_GT(events, 12);
  for (const int event : {events / 2, events - 8, events - 1}) {
    EXPECT_EQ(run("new", event).code, 128 + SIGKILL) << event;
    EXPECT_FALSE(fs::exists(folder_ / "new")) << event;
  }
  ASSERT_EQ(run("new", 0).code, 0);
  expect_same_files(folder_ / "whole", folder_ / "new");
}

}  // namespace
}  // namespace nadir
