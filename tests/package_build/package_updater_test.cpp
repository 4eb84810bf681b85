#include "package_build/package_updater.hpp"

#include <gmock/gmock.h>

#include <csignal>
#include <fstream>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "imagery/codecs.hpp"
#include "imagery/cog_reader.hpp"
#include "imagery/mbtiles.hpp"
#include "package/package_writer.hpp"
#include "package/tile_container.hpp"
#include "package/tile_set_diff.hpp"
#include "package/verify.hpp"
#include "package_build/package_builder.hpp"
#include "package_build/update_fixture.hpp"
#include "vision/place_index_builder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::PackageUpdate;

// Which tiles an update re-encodes, and their content: against arithmetic, `cache diff` and complete builds.

const cv::Rect kPatch(700, 900, 900, 500);  // in tiles 2 to 6, rows 3 to 5

class UpdatedPackage : public PackageUpdate {
 protected:
  UpdatedPackage() { write_map("patch.tif", kPatch, 1, "2024-09-01T00:00:00Z", "survey"); }

  TileSetDiff diff(const std::string& a, const std::string& b) {
    NoProgress progress;
    return diff_tile_sets(folder_ / a / kImageryFile, folder_ / b / kImageryFile, progress);
  }
  void expect_accepted(const std::string& package) {
    NoProgress progress;
    VerifyOptions options;
    options.root = &root_;
    options.depth = VerifyDepth::full;
    options.at = parse_utc("2024-11-01").value();
    const Verification result = verify_package(folder_ / package, options, progress);
    EXPECT_TRUE(result.accepted());
    for (const Finding& finding : result.findings.items()) ADD_FAILURE() << to_text(finding);
  }
};

TEST_F(UpdatedPackage, ReencodesExactlyTheTilesThatNewImageryTouches) {
  build_old();
  const UpdateReport report = update(request({"patch.tif"}));
  ASSERT_FALSE(report.package.findings.has_errors());
  const std::set<TileKey> touched = touched_by(kPatch);
  const TileSetDiff found = diff("old", "new");
  std::set<TileKey> changed;
  for (const TileChange& change : found.changed) changed.insert(change.key);
  EXPECT_EQ(changed, touched);
  EXPECT_EQ(report.counts.reencoded, touched.size());
  EXPECT_EQ(report.counts.copied, found.same);
  EXPECT_EQ(report.counts.copied + report.counts.reencoded, report.package.tiles);
  EXPECT_EQ(report.counts.added + report.counts.dropped, 0U);
  EXPECT_TRUE(found.added.empty() && found.removed.empty() && found.redescribed.empty());
  EXPECT_EQ(report.old_sequence, 1);
  EXPECT_EQ(report.sequence, 2);
  expect_accepted("new");
}

TEST_F(UpdatedPackage, SidecarsEqualThoseOfABuildFromBoth) {
  build_old();
  ASSERT_FALSE(update(request({"patch.tif"})).package.findings.has_errors());
  ASSERT_FALSE(build("both", "new.yaml", {"old.tif", "patch.tif"}).findings.has_errors());
  const std::vector<Sidecar> updated = sidecars("new"), built = sidecars("both");
  ASSERT_EQ(updated.size(), built.size());
  std::set<std::string> sources;
  for (std::size_t i = 0; i < built.size(); ++i) {
    EXPECT_EQ(updated[i].key, built[i].key);
    EXPECT_EQ(updated[i].source, built[i].source) << to_text(built[i].key);
    EXPECT_EQ(updated[i].captured_at, built[i].captured_at) << to_text(built[i].key);
    EXPECT_EQ(updated[i].valid_ppm, built[i].valid_ppm);
    EXPECT_EQ(updated[i].sector, built[i].sector);
    sources.insert(updated[i].source);
  }
  EXPECT_THAT(sources, testing::IsSupersetOf({"archive", "survey", "archive + survey"}));
}

TEST_F(UpdatedPackage, PixelsEqualThoseOfABuildFromBothWithinJpegsError) {
  build_old();
  ASSERT_FALSE(update(request({"patch.tif"})).package.findings.has_errors());
  ASSERT_FALSE(build("both", "new.yaml", {"old.tif", "patch.tif"}).findings.has_errors());
  const MbtilesReader old(folder_ / "old" / kImageryFile), updated(folder_ / "new" / kImageryFile),
      built(folder_ / "both" / kImageryFile);
  const std::set<TileKey> touched = touched_by(kPatch);
  for (const Sidecar& sidecar : sidecars("new")) {
    const Bytes bytes = updated.read(sidecar.key).value();
    if (!touched.contains(sidecar.key)) {
      EXPECT_EQ(bytes, old.read(sidecar.key)) << to_text(sidecar.key);
      continue;
    }
    const cv::Mat a = decode_image(bytes, Colour::bgr, "a").image;
    const cv::Mat b = decode_image(built.read(sidecar.key).value(), Colour::bgr, "b").image;
    EXPECT_LT(cv::norm(a, b, cv::NORM_L1) / static_cast<double>(a.total() * 3), 3.0) << to_text(sidecar.key);
  }
}

// Without loss there is no difference at all between updating and building from everything.
TEST_F(UpdatedPackage, WithPngItEqualsTheBuildFromBothByteForByte) {
  write_map("old.tif", {0, 0, 2560, 2560}, 0, "2024-03-01T00:00:00Z", "archive", cv::Rect(100, 100, 300, 500));
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}, ImageFormat::png).findings.has_errors());
  ASSERT_FALSE(update(request({"patch.tif"})).package.findings.has_errors());
  ASSERT_FALSE(build("both", "new.yaml", {"old.tif", "patch.tif"}, ImageFormat::png).findings.has_errors());
  expect_same_files(folder_ / "new", folder_ / "both");
}

TEST_F(UpdatedPackage, ImageryThatCoversEverythingGivesTheBytesOfABuild) {
  write_map("all.tif", {0, 0, 2560, 2560}, 2, "2024-09-01T00:00:00Z", "survey");
  build_old();
  const UpdateReport report = update(request({"all.tif"}));
  EXPECT_EQ(report.counts.copied, 0U);
  ASSERT_FALSE(build("alone", "new.yaml", {"all.tif"}).findings.has_errors());
  expect_same_files(folder_ / "new", folder_ / "alone");
}

TEST_F(UpdatedPackage, SameBytesForAnyNumberOfThreadsHardAndFeathered) {
  build_old();
  for (const double feather_m : {0.0, 6.0}) {
    for (const int threads : {1, 3}) {
      UpdateRequest wanted = request({"patch.tif"}, fmt::format("new{}.{}", feather_m, threads));
      wanted.tiles.threads = threads;
      wanted.tiles.mosaic.feather_m = feather_m;
      ASSERT_FALSE(update(wanted).package.findings.has_errors());
    }
    expect_same_files(folder_ / fmt::format("new{}.1", feather_m), folder_ / fmt::format("new{}.3", feather_m));
  }
  EXPECT_FALSE(diff("new0.1", "new6.1").empty()) << "seams differ";
}

TEST_F(UpdatedPackage, OlderImageryOnlyFillsHolesUnlessItHasPriority) {
  const cv::Rect hole(20, 30, 200, 100);
  write_map("old.tif", {0, 0, 2560, 2560}, 0, "2024-03-01T00:00:00Z", "archive", hole);
  write_map("older.tif", {0, 0, 1000, 300}, 1, "2024-02-01T00:00:00Z", "survey");
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.has_errors());
  const UpdateReport report = update(request({"older.tif"}));
  ASSERT_FALSE(report.package.findings.has_errors());
  EXPECT_EQ(report.counts.reencoded, touched_by(hole).size());
  UpdateRequest on_top = request({"older.tif"}, "top");
  on_top.tiles.mosaic.order = MosaicOrder::priority;
  EXPECT_EQ(update(on_top).counts.reencoded, touched_by({0, 0, 1000, 300}).size());
}

// Twice updated: tiles of three origins lie beside each other.
TEST_F(UpdatedPackage, AnUpdateCanBeUpdated) {
  const cv::Rect second(1500, 1200, 600, 700);
  write_map("second.tif", second, 2, "2024-08-01T00:00:00Z", "other");  // older than the patch, newer than the rest
  write_mission("third.yaml", 3);
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}, ImageFormat::png).findings.has_errors());
  ASSERT_FALSE(update(request({"patch.tif"})).package.findings.has_errors());
  UpdateRequest next = request({"second.tif"}, "third");
  next.old_package = folder_ / "new";
  next.mission = folder_ / "third.yaml";
  ASSERT_FALSE(update(next).package.findings.has_errors());
  expect_accepted("third");
  // A tile of both counts as old as its oldest part, so the second raster lies on top in tiles where the patch is not
  // alone; where it is, the patch stays.
  for (const Sidecar& tile : sidecars("third")) {
    if (tile.key.z == kZoom && tile.key.x == kColumn + 4 && tile.key.y == kRow + 4) {
      EXPECT_EQ(tile.source, "survey");
    }
    if (tile.key.z == kMinZoom) {
      EXPECT_EQ(tile.captured_at, parse_utc("2024-03-01T00:00:00Z"));
    }
  }
}

TEST_F(UpdatedPackage, ASmallerMissionDropsTilesAndNeedsNoImagery) {
  build_old();
  write_mission("new.yaml", 2, 0, 1);
  const UpdateReport report = update(request({}));
  ASSERT_FALSE(report.package.findings.has_errors());
  const TileSetDiff found = diff("old", "new");
  EXPECT_EQ(report.counts.dropped, found.removed.size());
  EXPECT_GT(report.counts.dropped, 20U);
  EXPECT_EQ(report.counts.reencoded + report.counts.added, 0U);
  EXPECT_TRUE(found.added.empty() && found.changed.empty());
  expect_accepted("new");
}

TEST_F(UpdatedPackage, ALargerMissionNeedsImageryForTheAddedArea) {
  build_old();
  write_mission("new.yaml", 2, 6, 11);
  expect_refused(request({}), "coverage.gap");
  write_map("east.tif", {2300, 0, 1024, 2560}, 1, "2024-09-01T00:00:00Z", "survey");
  const UpdateReport report = update(request({"east.tif"}));
  ASSERT_FALSE(report.package.findings.has_errors());
  const TileSetDiff found = diff("old", "new");
  EXPECT_EQ(report.counts.added, found.added.size());
  EXPECT_EQ(report.counts.reencoded, found.changed.size());
  EXPECT_EQ(report.counts.dropped, found.removed.size());
  EXPECT_GT(report.counts.added, 20U);
  expect_accepted("new");
}

TEST_F(UpdatedPackage, SectorsAreThoseOfTheNewMission) {
  build_old();
  write_mission("new.yaml", 2, 3, 6, {{"id: middle", "id: centre"}});
  ASSERT_FALSE(update(request({})).package.findings.has_errors());
  std::set<std::string> sectors;
  for (const Sidecar& tile : sidecars("new")) sectors.insert(tile.sector);
  EXPECT_THAT(sectors, testing::ElementsAre("", "centre"));
}

// What an update rejects, and that it then leaves nothing.

class UpdateErrors : public PackageUpdate {
 protected:
  UpdateErrors() { write_map("patch.tif", {700, 900, 900, 500}, 1, "2024-09-01T00:00:00Z", "survey"); }

  void make_old_with_terrain() {
    const std::map<std::string, std::string> dem{{"mode: flat", "mode: dem"}};
    write_mission("old.yaml", 1, 3, 6, dem);
    write_mission("new.yaml", 2, 3, 6, dem);
    const double pixel_m = 32 * mercator_pixel_m(kZoom), half_m = kPi * kMercatorRadius_m;
    test::RasterSpec spec;
    spec.kind = test::Kind::grey;
    spec.epsg = 3857;
    spec.width = spec.height = 300;
    spec.transform = {
        {static_cast<double>(kColumn * kTileSize) * mercator_pixel_m(kZoom) - half_m - 100 * pixel_m, pixel_m, 0,
         half_m - static_cast<double>(kRow * kTileSize) * mercator_pixel_m(kZoom) + 100 * pixel_m, 0, -pixel_m}};
    test::write_raster(folder_ / "dem.tif", spec, [](int column, int row) -> std::array<int, 4> {
      return {(column + row) / 4, 0, 0, 0};
    });
    PackageRequest wanted = build_request("old", "old.yaml", {"old.tif"});
    wanted.dem = {folder_ / "dem.tif"};
    NoProgress progress;
    ASSERT_FALSE(build_package(wanted, progress).findings.has_errors());
  }

  // Changes the blob of one tile in place; the file keeps its size and its sidecars.
  void spoil_tile(const std::string& where) {
    const auto result = test::run_process(
        {"sqlite3", (folder_ / "old" / kImageryFile).string(),
         "UPDATE tiles SET tile_data = substr(tile_data, 1, length(tile_data) - 9) || x'00' || substr(tile_data, -8) "
         "WHERE " +
             where});
    ASSERT_EQ(result.code, 0) << result.err;
  }
};

TEST_F(UpdateErrors, SequenceSeriesAndZoom) {
  write_mission("old.yaml", 2);
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.has_errors());
  for (const int sequence : {1, 2}) {
    write_mission("new.yaml", sequence);
    expect_refused(request({"patch.tif"}), "package.rollback");
  }
  write_mission("new.yaml", 3, 3, 6, {{"series: field", "series: other"}});
  expect_refused(request({"patch.tif"}), "mission.mismatch");
  write_mission("new.yaml", 3, 3, 6, {{"min: 14", "min: 15"}});
  expect_refused(request({"patch.tif"}), "mission.mismatch");
}

TEST_F(UpdateErrors, AnUntrustedOrUnsignedPackage) {
  build_old();
  const PrivateKey other = PrivateKey::generate();
  TrustRoot foreign;
  foreign.expires = root_.expires;
  foreign.add_key(other.public_key());
  foreign.root.key_ids = foreign.package_signer.key_ids = {other.public_key().id()};
  UpdateRequest wanted = request({"patch.tif"});
  wanted.trust = &foreign;
  expect_refused(wanted, "key.unknown");
  root_.revoked = {key_.public_key().id()};
  expect_refused(request({"patch.tif"}), "key.revoked");
  root_.revoked.clear();
  fs::remove(folder_ / "old" / kSignatureFile);
  expect_refused(request({"patch.tif"}), "signature.missing");
}

// Quick verification does not find it; copying the tile or mosaicking over it does.
TEST_F(UpdateErrors, ADamagedTileThatIsCopied) {
  build_old();
  spoil_tile(fmt::format("zoom_level = 19 AND tile_column = {} AND tile_row = {}", kColumn, (1 << 19) - 1 - kRow));
  expect_refused(request({"patch.tif"}), "artifact.hash");
}

TEST_F(UpdateErrors, ADamagedTileThatIsMosaicked) {
  build_old();
  spoil_tile(
      fmt::format("zoom_level = 19 AND tile_column = {} AND tile_row = {}", kColumn + 2, (1 << 19) - 1 - (kRow + 3)));
  expect_refused(request({"patch.tif"}), "artifact.hash");
}

TEST_F(UpdateErrors, ForgedSidecars) {
  build_old();
  ASSERT_EQ(test::run_process({"sqlite3", (folder_ / "old" / kImageryFile).string(),
                               "UPDATE nadir_sidecars SET captured_at = '2024-10-01T00:00:00Z'"})
                .code,
            0);
  expect_refused(request({"patch.tif"}), "tiles.root");
}

TEST_F(UpdateErrors, ErrorsOfABuild) {
  build_old();
  write_mission("new.yaml", 2, 3, 6, {{"active: 400", "active: 100"}});  // the old tiles are 243 days old
  expect_refused(request({"patch.tif"}), "freshness.stale");
  write_mission("new.yaml", 2, 3, 6, {{"min_resolution_m: 0.5", "min_resolution_m: 0.29"}});
  expect_refused(request({"patch.tif"}), "resolution.coarse");
  write_mission("new.yaml", 2, 3, 6, {{"budget_mb: 50", "budget_mb: 1"}});
  expect_refused(request({"patch.tif"}), "budget.exceeded");
  write_mission("new.yaml", 2, 3, 6, {{"mode: flat", "mode: dem"}});
  expect_refused(request({"patch.tif"}), "dem.gap");
  write_mission("new.yaml", 2);
  UpdateRequest late = request({"patch.tif"});
  late.at = parse_utc("2024-12-01T00:00:00Z");
  expect_refused(late, "package.expired");
}

// That the old one is stale and out of date is why it is updated.
TEST_F(UpdateErrors, AnOldPackageThatMayNotFlyAnyMoreIsAccepted) {
  build_old();
  write_map("all.tif", {0, 0, 2560, 2560}, 2, "2026-09-01T00:00:00Z", "survey");
  write_mission("new.yaml", 2, 3, 6, {{"created: 2024", "created: 2026"}, {"expires: 2024", "expires: 2026"}});
  EXPECT_FALSE(update(request({"all.tif"})).package.findings.has_errors());
}

TEST_F(UpdateErrors, ErrorsLeaveNothing) {
  build_old();
  EXPECT_THROW(update(request({"missing.tif"})), Error);
  UpdateRequest wanted = request({"patch.tif"});
  wanted.old_package = folder_ / "nowhere";
  EXPECT_THROW(update(wanted), Error);
  wanted = request({"patch.tif"});
  wanted.out = folder_ / "old";  // never replaces
  EXPECT_THROW(update(wanted), Error);
  EXPECT_FALSE(fs::exists(folder_ / "new"));
}

TEST_F(UpdateErrors, AKilledUpdateLeavesNothingAndTheNextOneWorks) {
  build_old();
  folder_.write("root.json", sign_root(root_, {&key_}).json());
  write_file_atomic(folder_ / "k.pem", key_.pem(), 0600);
  const auto run = [&](const std::string& out, int event) {
    return test::run_process({NADIR_KILLED_UPDATE, folder_ / "old", folder_ / "root.json", folder_ / "new.yaml",
                              folder_ / "patch.tif", folder_ / "k.pem", folder_ / out, std::to_string(event)});
  };
  const auto whole = run("whole", 0);
  ASSERT_EQ(whole.code, 0) << whole.err;
  const int events = std::stoi(whole.out);
  ASSERT_GT(events, 8);
  for (const int event : {1, 4, events / 2, events - 3, events - 2, events - 1}) {
    EXPECT_EQ(run("new", event).code, 128 + SIGKILL) << event;
    EXPECT_FALSE(fs::exists(folder_ / "new")) << event;
  }
  ASSERT_EQ(run("new", 0).code, 0);
  expect_same_files(folder_ / "whole", folder_ / "new");
}

TEST_F(UpdateErrors, ADamagedTerrainIsNotCopied) {
  make_old_with_terrain();
  const fs::path terrain = folder_ / "old" / kTerrainFile;
  EXPECT_FALSE(update(request({"patch.tif"}, "sound")).package.findings.has_errors());
  EXPECT_EQ(read_file(folder_ / "sound" / kTerrainFile), read_file(terrain));
  Bytes bytes = read_file(terrain);
  bytes.back() ^= 1;
  std::ofstream(terrain, std::ios::binary).write(as_text(bytes).data(), static_cast<std::streamsize>(bytes.size()));
  expect_refused(request({"patch.tif"}), "artifact.hash");
  UpdateRequest fresh = request({"patch.tif"});
  fresh.dem = {folder_ / "dem.tif"};
  EXPECT_FALSE(update(fresh).package.findings.has_errors());
}

TEST_F(UpdateErrors, RootsAreCarriedOnAndMustBeConsecutive) {
  build_old();
  const auto next = [&](const TrustRoot& before, const std::string& name, const PrivateKey& key) {
    TrustRoot root = before;
    ++root.version;
    folder_.write(name, sign_root(root, {&key}).json());
    return root;
  };
  const TrustRoot second = next(root_, "2.json", key_);
  next(second, "3.json", key_);
  next(root_, "false.json", PrivateKey::generate());
  UpdateRequest wanted = request({"patch.tif"});
  wanted.roots = {folder_ / "3.json"};
  EXPECT_THROW(update(wanted), UsageError) << "the second is missing";
  wanted.roots = {folder_ / "false.json"};
  EXPECT_THROW(update(wanted), Error) << "not signed by the first";
  wanted.roots = {folder_ / "3.json", folder_ / "2.json"};
  ASSERT_FALSE(update(wanted).package.findings.has_errors());
  EXPECT_TRUE(fs::exists(folder_ / "new" / root_file_name(3)));
  // From there on they travel without being named.
  write_mission("third.yaml", 3);
  UpdateRequest later = request({}, "third");
  later.old_package = folder_ / "new";
  later.mission = folder_ / "third.yaml";
  ASSERT_FALSE(update(later).package.findings.has_errors());
  EXPECT_EQ(roots_in_package(Directory(folder_ / "third")).size(), 2U);
}

TEST_F(UpdateErrors, WarnsWhenTheKeyMayNotSign) {
  build_old();
  const PrivateKey unknown_key = PrivateKey::generate();
  UpdateRequest wanted = request({"patch.tif"});
  wanted.key = &unknown_key;
  EXPECT_FALSE(update(wanted).package.findings.has_errors());
  EXPECT_THAT(remarks_, testing::ElementsAre(testing::HasSubstr("aircraft will reject")));
}

// Updates of packages in COGs and from one container to the other, against whole builds.

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
    ASSERT_FALSE(build_package(wanted, progress).findings.has_errors());
  }
  void add_index(const std::string& name) {
    const fs::path package = folder_ / name;
    const Manifest manifest = load_package_manifest(package);
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

class ContainerConversion : public UpdateOfCogs,
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
TEST_P(ContainerConversion, WithoutChangesItEqualsTheBuildByteForByte) {
  make("old", "old.yaml", {"old.tif"}, before(), kJpeg);
  const UpdateReport report = update(wanted({}));
  ASSERT_FALSE(report.package.findings.has_errors());
  EXPECT_EQ(report.counts.copied, report.package.tiles);
  make("whole", "new.yaml", {"old.tif"}, after(), kJpeg);
  expect_same_files(folder_ / "new", folder_ / "whole");
}

// Without loss there is no difference at all between updating and building from everything.
TEST_P(ContainerConversion, WithLosslessTilesItEqualsTheBuildFromBothByteForByte) {
  // 6 x 6 tiles: encoding without loss takes its time.
  write_map("old.tif", {512, 512, 1536, 1536}, 0, "2024-03-01T00:00:00Z", "archive", cv::Rect(550, 600, 150, 500));
  make("old", "old.yaml", {"old.tif"}, before(), kLossless);
  const UpdateReport report = update(wanted({"patch.tif"}));
  ASSERT_FALSE(report.package.findings.has_errors());
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

INSTANTIATE_TEST_SUITE_P(All, ContainerConversion,
                         testing::Values(std::pair{TileSetKind::cog, TileSetKind::cog},
                                         std::pair{TileSetKind::cog, TileSetKind::mbtiles},
                                         std::pair{TileSetKind::mbtiles, TileSetKind::cog}),
                         name_of);

// There and back: what leaves a container is what came into it.
TEST_F(UpdateOfCogs, ConvertingBackGivesTheSamePackage) {
  make("old", "old.yaml", {"old.tif"}, TileSetKind::mbtiles, kJpeg);
  UpdateRequest there = request({"patch.tif"});
  there.container = TileSetKind::cog;
  ASSERT_FALSE(update(there).package.findings.has_errors());
  ASSERT_FALSE(update(request({"patch.tif"}, "straight")).package.findings.has_errors());
  write_mission("third.yaml", 3);
  for (const auto& [from, to] : {std::pair{"new", "back"}, {"straight", "third"}}) {
    UpdateRequest next = request({}, to);
    next.old_package = folder_ / from;
    next.mission = folder_ / "third.yaml";
    next.container = TileSetKind::mbtiles;
    ASSERT_FALSE(update(next).package.findings.has_errors());
  }
  expect_same_files(folder_ / "back", folder_ / "third");
}

TEST_F(UpdateOfCogs, SameBytesForAnyNumberOfThreads) {
  make("old", "old.yaml", {"old.tif"}, TileSetKind::cog, kJpeg);
  for (const int threads : {1, 3}) {
    UpdateRequest wanted = request({"patch.tif"}, "new" + std::to_string(threads));
    wanted.tiles.threads = threads;
    ASSERT_FALSE(update(wanted).package.findings.has_errors());
  }
  expect_same_files(folder_ / "new1", folder_ / "new3");
}

TEST_F(UpdateOfCogs, PngTilesCannotBeCopiedIntoACog) {
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}, ImageFormat::png).findings.has_errors());
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

// Quick verification does not find it; copying the tile or mosaicking over it does.
TEST_F(UpdateOfCogs, ADamagedTileIsNotCopied) {
  make("old", "old.yaml", {"old.tif"}, TileSetKind::cog, kJpeg);
  const CogReader reader(folder_ / "old" / kCogFile);
  const CogLevel& finest = *reader.level(kZoom);
  const auto spoil = [&](std::uint32_t column, std::uint32_t row) {
    const auto at = static_cast<std::size_t>((kRow + row - finest.north / kTileSize) * finest.picture.across + kColumn +
                                             column - finest.west / kTileSize);
    ASSERT_GT(finest.picture.sizes[at], 0U);
    std::fstream file(folder_ / "old" / kCogFile, std::ios::binary | std::ios::in | std::ios::out);
    file.seekg(static_cast<std::streamoff>(finest.picture.places[at] + finest.picture.sizes[at] / 2));
    const int byte = file.peek();
    file.seekp(file.tellg());
    file.put(static_cast<char>(byte ^ 1));
  };
  spoil(4, 4);  // under the patch
  expect_refused(request({"patch.tif"}), "artifact.hash");
  spoil(4, 4);  // back to what it was
  ASSERT_FALSE(update(request({"patch.tif"}, "sound")).package.findings.has_errors());
  spoil(0, 0);
  for (const auto container : {TileSetKind::cog, TileSetKind::mbtiles}) {
    UpdateRequest wanted = request({"patch.tif"});
    wanted.container = container;
    expect_refused(wanted, "artifact.hash");
  }
}

// While tiles are copied, while the index is rebuilt, while the package is completed.
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
