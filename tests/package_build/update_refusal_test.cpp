// What an update refuses, and that it then leaves nothing.
#include <csignal>
#include <fstream>

#include "base/error.hpp"
#include "package_build/update_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::PackageUpdate;

class UpdateRefusal : public PackageUpdate {
 protected:
  UpdateRefusal() { write_map("patch.tif", {700, 900, 900, 500}, 1, "2024-09-01T00:00:00Z", "survey"); }
  void make_old() { ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.refuses()); }

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
    wanted.dem = folder_ / "dem.tif";
    NoProgress progress;
    ASSERT_FALSE(build_package(wanted, progress).findings.refuses());
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

TEST_F(UpdateRefusal, SequenceSeriesAndZoom) {
  write_mission("old.yaml", 2);
  make_old();
  for (const int sequence : {1, 2}) {
    write_mission("new.yaml", sequence);
    expect_refused(request({"patch.tif"}), "package.rollback");
  }
  write_mission("new.yaml", 3, 3, 6, {{"series: field", "series: other"}});
  expect_refused(request({"patch.tif"}), "mission.mismatch");
  write_mission("new.yaml", 3, 3, 6, {{"min: 14", "min: 15"}});
  expect_refused(request({"patch.tif"}), "mission.mismatch");
}

TEST_F(UpdateRefusal, APackageOfStrangersOrWithoutSignature) {
  make_old();
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

// Quick verification does not see it; whoever copies the tile, or lays imagery upon it, does.
TEST_F(UpdateRefusal, ADamagedTileThatIsCopied) {
  make_old();
  spoil_tile(fmt::format("zoom_level = 19 AND tile_column = {} AND tile_row = {}", kColumn, (1 << 19) - 1 - kRow));
  expect_refused(request({"patch.tif"}), "artifact.hash");
}

TEST_F(UpdateRefusal, ADamagedTileThatIsMosaicked) {
  make_old();
  spoil_tile(
      fmt::format("zoom_level = 19 AND tile_column = {} AND tile_row = {}", kColumn + 2, (1 << 19) - 1 - (kRow + 3)));
  expect_refused(request({"patch.tif"}), "artifact.hash");
}

TEST_F(UpdateRefusal, ForgedSidecars) {
  make_old();
  ASSERT_EQ(test::run_process({"sqlite3", (folder_ / "old" / kImageryFile).string(),
                               "UPDATE nadir_sidecars SET captured_at = '2024-10-01T00:00:00Z'"})
                .code,
            0);
  expect_refused(request({"patch.tif"}), "tiles.root");
}

TEST_F(UpdateRefusal, WhatABuildWouldRefuse) {
  make_old();
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
TEST_F(UpdateRefusal, NotForWhatOnlyMakesTheOldOneUnfit) {
  make_old();
  write_map("all.tif", {0, 0, 2560, 2560}, 2, "2026-09-01T00:00:00Z", "survey");
  write_mission("new.yaml", 2, 3, 6, {{"created: 2024", "created: 2026"}, {"expires: 2024", "expires: 2026"}});
  EXPECT_FALSE(update(request({"all.tif"})).package.findings.refuses());
}

TEST_F(UpdateRefusal, ErrorsLeaveNothing) {
  make_old();
  EXPECT_THROW(update(request({"missing.tif"})), Error);
  UpdateRequest wanted = request({"patch.tif"});
  wanted.old_package = folder_ / "nowhere";
  EXPECT_THROW(update(wanted), Error);
  wanted = request({"patch.tif"});
  wanted.out = folder_ / "old";  // never replaces
  EXPECT_THROW(update(wanted), Error);
  EXPECT_FALSE(fs::exists(folder_ / "new"));
}

TEST_F(UpdateRefusal, AKilledUpdateLeavesNothingAndTheNextOneWorks) {
  make_old();
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

TEST_F(UpdateRefusal, ADamagedTerrainIsNotTakenOver) {
  make_old_with_terrain();
  const fs::path terrain = folder_ / "old" / kTerrainFile;
  EXPECT_FALSE(update(request({"patch.tif"}, "sound")).package.findings.refuses());
  EXPECT_EQ(read_file(folder_ / "sound" / kTerrainFile), read_file(terrain));
  Bytes bytes = read_file(terrain);
  bytes.back() ^= 1;
  std::ofstream(terrain, std::ios::binary).write(as_text(bytes).data(), static_cast<std::streamsize>(bytes.size()));
  expect_refused(request({"patch.tif"}), "artifact.hash");
  UpdateRequest fresh = request({"patch.tif"});
  fresh.dem = folder_ / "dem.tif";
  EXPECT_FALSE(update(fresh).package.findings.refuses());
}

TEST_F(UpdateRefusal, RootsTravelOnAndMustFollowOneAnother) {
  make_old();
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
  ASSERT_FALSE(update(wanted).package.findings.refuses());
  EXPECT_TRUE(fs::exists(folder_ / "new" / root_file_name(3)));
  // From there on they travel without being named.
  write_mission("third.yaml", 3);
  UpdateRequest later = request({}, "third");
  later.old_package = folder_ / "new";
  later.mission = folder_ / "third.yaml";
  ASSERT_FALSE(update(later).package.findings.refuses());
  EXPECT_EQ(roots_in_package(folder_ / "third").size(), 2U);
}

TEST_F(UpdateRefusal, TellsWhenTheKeyMayNotSign) {
  make_old();
  const PrivateKey stranger = PrivateKey::generate();
  UpdateRequest wanted = request({"patch.tif"});
  wanted.key = &stranger;
  EXPECT_FALSE(update(wanted).package.findings.refuses());
  EXPECT_THAT(remarks_, testing::ElementsAre(testing::HasSubstr("aircraft will refuse")));
}

}  // namespace
}  // namespace nadir
