// nadir cache update and cache build --carry-root as a user calls them. GDAL cuts the newer imagery out of the old map;
// cache diff counts what changed.
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "commands/command_fixture.hpp"
#include "package/package_maker.hpp"
#include "support/process.hpp"
#include "vision/place_index_files.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class CacheUpdate : public test::CommandTest {
 protected:
  CacheUpdate() {
    maker_.make(folder_, "old");
    folder_.write("root.json", sign_root(maker_.root, {&maker_.signer}).json());
    write_file_atomic(folder_ / "p.key.pem", maker_.signer.pem(), 0600);
    folder_.write("next.yaml", test::mission_yaml({{"sequence: 3", "sequence: 4"}}));
  }
  int update(std::initializer_list<std::string> more) {
    std::vector<std::string> args{"cache",      "update", "@old",       "--trust", "@root.json", "--mission",
                                  "@next.yaml", "--key",  "@p.key.pem", "--out",   "@new"};
    args.insert(args.end(), more);
    return run(args);
  }

  // A window of the old map as a GeoTIFF, made brighter.
  void cut_imagery(const std::string& name, const std::string& window) {
    const auto cut = test::run_shell("gdal_translate -q -of GTiff -b 1 -b 2 -b 3 -scale 0 255 60 255 " + window + " '" +
                                     path("old/imagery/base.mbtiles") + "' '" + path(name) + "'");
    ASSERT_EQ(cut.code, 0) << cut.err;
  }
  const std::vector<std::string> facts_{"--captured", "2024-04-10", "--gsd-m",    "0.3",
                                        "--ce90-m",   "4",          "--provider", "gdal"};

  // The next version of the maker's root, signed by `key`; another key signs packages when `signer` names one.
  TrustRoot root_after(const TrustRoot& before, const std::string& name, const PrivateKey& key) {
    TrustRoot root = before;
    ++root.version;
    folder_.write(name, sign_root(root, {&key}).json());
    return root;
  }
};

TEST_F(CacheUpdate, ANewMissionAloneCopiesEveryTile) {
  ASSERT_EQ(update({"--json"}), 0) << out_.str() << err_.str();
  const json report = result();
  EXPECT_EQ(report["from_sequence"], 3);
  EXPECT_EQ(report["sequence"], 4);
  EXPECT_EQ(report["copied"], report["tiles"]);
  EXPECT_EQ(report["reencoded"], 0);
  EXPECT_EQ(run({"cache", "verify", "@new", "--trust", "@root.json", "--depth", "full"}), 0) << out_.str();
  // sqlite3's word: the same tiles and the same sidecars
  const auto differences = test::run_process(
      {"sqlite3", path("new/imagery/base.mbtiles"),
       "ATTACH '" + path("old/imagery/base.mbtiles") +
           "' AS o; SELECT count(*) FROM (SELECT * FROM tiles EXCEPT SELECT * "
           "FROM o.tiles); SELECT count(*) FROM (SELECT zoom_level, tile_column, tile_row, sha256, source, "
           "captured_at, "
           "gsd_mm, ce90_mm, trust, valid_ppm, mask FROM nadir_sidecars EXCEPT SELECT zoom_level, tile_column, "
           "tile_row, "
           "sha256, source, captured_at, gsd_mm, ce90_mm, trust, valid_ppm, mask FROM o.nadir_sidecars); "
           "SELECT count(*) - (SELECT count(*) FROM o.tiles) FROM tiles; PRAGMA integrity_check"});
  EXPECT_EQ(differences.out, "0\n0\n0\nok\n") << differences.err;
}

TEST_F(CacheUpdate, NewImageryChangesTheTilesThatCacheDiffLists) {
  if (test::run_shell("command -v gdal_translate").code != 0) GTEST_SKIP() << "NOT TESTED: no gdal_translate";
  cut_imagery("new.tif", "-srcwin 300 300 250 250");
  std::vector<std::string> args{"cache", "update",     "@old",  "--trust", "@root.json", "--mission", "@next.yaml",
                                "--key", "@p.key.pem", "--out", "@new",    "--imagery",  "@new.tif",  "--json"};
  args.insert(args.end(), facts_.begin(), facts_.end());
  ASSERT_EQ(run(args), 0) << out_.str() << err_.str();
  const json report = result();
  EXPECT_EQ(run({"cache", "diff", "@old", "@new", "--json"}), 1);
  const json diff = result();
  EXPECT_EQ(report["reencoded"], diff["changed"].size());
  EXPECT_GT(report["reencoded"], 2);
  EXPECT_EQ(report["copied"], diff["unchanged_tiles"]);
  EXPECT_EQ(run({"cache", "verify", "@new", "--trust", "@root.json", "--depth", "full"}), 0) << out_.str();
  // Once more: the same bytes.
  for (std::string& arg : args) {
    if (arg == "@new") arg = "@again";
  }
  ASSERT_EQ(run(args), 0) << err_.str();
  EXPECT_EQ(test::run_process({"diff", "-r", path("new"), path("again")}).code, 0);
}

TEST_F(CacheUpdate, ARejectionListsFindingsAndLeavesNoOutput) {
  folder_.write("next.yaml", test::mission_yaml());
  EXPECT_EQ(update({"--json"}), 1);
  EXPECT_EQ(result()["findings"][0]["code"], "package.rollback");
  folder_.write("next.yaml", test::mission_yaml({{"sequence: 3", "sequence: 4"}, {"stable: 730", "stable: 5"}}));
  EXPECT_EQ(update({}), 1);
  EXPECT_NE(out_.str().find("freshness.stale"), std::string::npos) << out_.str();
  EXPECT_FALSE(fs::exists(folder_ / "new"));
}

TEST_F(CacheUpdate, WrongUsageIsNamed) {
  EXPECT_EQ(run({"cache", "update", "@old", "--mission", "@next.yaml", "--out", "@new"}), 2) << "--trust is missing";
  EXPECT_EQ(update({"--imagery", "@none.tif"}), 2);
  EXPECT_EQ(run({"cache", "update", "@nowhere", "--trust", "@root.json", "--mission", "@next.yaml", "--out", "@new"}),
            2);
  EXPECT_TRUE(out_.str().empty());
  EXPECT_FALSE(fs::exists(folder_ / "new"));
}

TEST_F(CacheUpdate, CarriedRootsMustBeConsecutive) {
  const TrustRoot second = root_after(maker_.root, "2.json", maker_.signer);
  root_after(second, "3.json", maker_.signer);
  root_after(second, "forged.json", PrivateKey::generate());
  EXPECT_EQ(update({"--carry-root", "@3.json"}), 2) << "the second is missing";
  EXPECT_EQ(update({"--carry-root", "@2.json", "--carry-root", "@forged.json"}), 2);
  EXPECT_FALSE(fs::exists(folder_ / "new"));
  ASSERT_EQ(update({"--carry-root", "@2.json", "--carry-root", "@3.json"}), 0) << err_.str();
  ASSERT_EQ(run({"cache", "verify", "@new", "--trust", "@root.json", "--json"}), 0) << out_.str();
  EXPECT_EQ(result()["root_version"], 3);
}

class BuildWithRoots : public CacheUpdate {
 protected:
  BuildWithRoots() { second_ = root_after(maker_.root, "2.json", maker_.signer); }
  void SetUp() override {
    if (test::run_shell("command -v gdal_translate").code != 0) GTEST_SKIP() << "NOT TESTED: no gdal_translate";
    cut_imagery("map.tif", "");
  }
  int build(std::initializer_list<std::string> more) {
    fs::remove_all(folder_ / "new");
    std::vector<std::string> args{"cache",    "build", "--mission",  "@next.yaml", "--imagery",
                                  "@map.tif", "--key", "@p.key.pem", "--out",      "@new"};
    args.insert(args.end(), facts_.begin(), facts_.end());
    args.insert(args.end(), more);
    return run(args);
  }
  TrustRoot second_;
};

TEST_F(BuildWithRoots, AnOfflineAircraftFollowsThem) {
  ASSERT_EQ(build({"--carry-root", "@2.json", "--trust", "@root.json"}), 0) << out_.str() << err_.str();
  EXPECT_EQ(read_text_file(folder_ / "new/root/2.root.json"), read_text_file(folder_ / "2.json"));
  ASSERT_EQ(run({"cache", "verify", "@new", "--trust", "@root.json", "--depth", "full", "--json"}), 0) << out_.str();
  EXPECT_EQ(result()["root_version"], 2);
}

// TIFF has no PNG compression, and --format must not re-encode.
TEST_F(BuildWithRoots, PngTilesAreNotPutIntoACog) {
  folder_.write("next.yaml", test::mission_yaml());
  ASSERT_EQ(build({"--tile-format", "png"}), 0) << out_.str() << err_.str();
  fs::rename(folder_ / "new", folder_ / "png");
  folder_.write("next.yaml", test::mission_yaml({{"sequence: 3", "sequence: 4"}}));
  EXPECT_EQ(run({"cache", "update", "@png", "--trust", "@root.json", "--mission", "@next.yaml", "--key", "@p.key.pem",
                 "--out", "@cog", "--format", "cog"}),
            2);
  EXPECT_NE(err_.str().find("nadir cache build --format cog --tile-format png"), std::string::npos) << err_.str();
  EXPECT_FALSE(fs::exists(folder_ / "cog"));
}

TEST_F(BuildWithRoots, RejectsRootsThatAircraftCannotFollow) {
  root_after(second_, "3.json", maker_.signer);
  const PrivateKey attacker = PrivateKey::generate();
  TrustRoot stolen = maker_.root;
  stolen.add_key(attacker.public_key());
  stolen.root.key_ids = {attacker.public_key().id()};
  root_after(stolen, "stolen.json", attacker);  // signed by its own root keys, not by those before
  folder_.write("damaged.json", read_text_file(folder_ / "2.json").substr(0, 300));
  EXPECT_EQ(build({"--carry-root", "@3.json", "--trust", "@root.json"}), 2) << "skips the second";
  EXPECT_EQ(build({"--carry-root", "@stolen.json", "--trust", "@root.json"}), 2);
  EXPECT_EQ(build({"--carry-root", "@2.json", "--carry-root", "@stolen.json"}), 2) << "two of one version";
  EXPECT_EQ(build({"--carry-root", "@damaged.json"}), 2);
  EXPECT_EQ(build({"--carry-root", "@map.tif"}), 2);
  EXPECT_FALSE(fs::exists(folder_ / "new"));
}

TEST_F(BuildWithRoots, RespectsARootThatRevokesTheSigner) {
  TrustRoot next = maker_.root;
  next.version = 2;
  const PrivateKey other = PrivateKey::generate();
  next.add_key(other.public_key());
  next.package_signer.key_ids = {other.public_key().id()};
  folder_.write("next.json", sign_root(next, {&maker_.signer}).json());
  ASSERT_EQ(build({"--carry-root", "@next.json"}), 0) << err_.str();
  EXPECT_EQ(run({"cache", "verify", "@new", "--trust", "@root.json", "--json"}), 1);
  EXPECT_EQ(result()["findings"][0]["code"], "key.unknown");
}

// nadir cache update and the place index: made anew, left behind, or missing.

class UpdatedIndex : public test::CommandTest {
 protected:
  UpdatedIndex() {
    folder_.write("root.json", sign_root(maker_.root, {&maker_.signer}).json());
    write_file_atomic(folder_ / "p.key.pem", maker_.signer.pem(), 0600);
    folder_.write("next.yaml", test::mission_yaml({{"sequence: 3", "sequence: 4"}}));
  }
  int update(const std::string& old, const std::string& out, std::initializer_list<std::string> more) {
    std::vector<std::string> args{"cache",      "update", old,          "--trust", "@root.json", "--mission",
                                  "@next.yaml", "--key",  "@p.key.pem", "--out",   out};
    args.insert(args.end(), more);
    return run(args);
  }
  int index(const std::string& package, std::initializer_list<std::string> more = {}) {
    std::vector<std::string> args{"cache", "index",         package, "--key",         "@p.key.pem", "--overlap-percent",
                                  "10",    "--footprint-m", "110",   "--footprint-m", "150"};
    args.insert(args.end(), more);
    return run(args);
  }
  void expect_accepted(const std::string& package) {
    EXPECT_EQ(run({"cache", "verify", package, "--trust", "@root.json", "--depth", "full"}), 0) << out_.str();
  }
  void expect_same(const std::string& a, const std::string& b) {
    const auto result = test::run_process({"diff", "-r", (folder_ / a).string(), (folder_ / b).string()});
    EXPECT_EQ(result.code, 0) << result.out;
  }
  bool differ(const std::string& a, const std::string& b, std::string_view file) {
    return read_file(folder_ / a / file) != read_file(folder_ / b / file);
  }
};

// The index of the updated package is the one that `cache index` makes of it, by any number of threads.
TEST_F(UpdatedIndex, IsThatOfTheNewTiles) {
  if (test::run_shell("command -v gdal_translate").code != 0) GTEST_SKIP() << "NOT TESTED: no gdal_translate";
  maker_.make(folder_, "old");
  ASSERT_EQ(index("@old"), 0) << err_.str();
  const auto cut = test::run_process({"gdal_translate",
                                      "-q",
                                      "-of",
                                      "GTiff",
                                      "-b",
                                      "1",
                                      "-b",
                                      "2",
                                      "-b",
                                      "3",
                                      "-scale",
                                      "0",
                                      "255",
                                      "255",
                                      "0",
                                      "-srcwin",
                                      "300",
                                      "300",
                                      "250",
                                      "250",
                                      folder_ / "old/imagery/base.mbtiles",
                                      folder_ / "new.tif"});
  ASSERT_EQ(cut.code, 0) << cut.err;
  ASSERT_EQ(update("@old", "@new",
                   {"--index", "--threads", "3", "--imagery", "@new.tif", "--captured", "2024-04-10", "--gsd-m", "0.3",
                    "--ce90-m", "4", "--provider", "gdal"}),
            0)
      << out_.str() << err_.str();
  EXPECT_EQ(err_.str().find("not carried over"), std::string::npos) << err_.str();
  expect_accepted("@new");
  EXPECT_TRUE(differ("old", "new", kPlaceIndexFile));
  EXPECT_TRUE(differ("old", "new", kPlaceTableFile));
  fs::copy(folder_ / "new", folder_ / "indexed", fs::copy_options::recursive);
  ASSERT_EQ(index("@indexed", {"--threads", "1"}), 0) << err_.str();
  expect_same("new", "indexed");
}

// With the mission alone the descriptors stay what they were, whatever the containers are.
TEST_F(UpdatedIndex, IsRebuiltForAnotherContainer) {
  maker_.cog = true;
  maker_.make(folder_, "old");
  ASSERT_EQ(index("@old"), 0) << err_.str();
  ASSERT_EQ(update("@old", "@new", {"--index", "--format", "mbtiles"}), 0) << out_.str() << err_.str();
  EXPECT_FALSE(differ("old", "new", kPlaceIndexFile));
  expect_accepted("@new");
}

TEST_F(UpdatedIndex, IsNotCarriedOverUnlessRequested) {
  maker_.make(folder_, "old");
  ASSERT_EQ(index("@old"), 0) << err_.str();
  ASSERT_EQ(update("@old", "@new", {}), 0) << err_.str();
  EXPECT_NE(err_.str().find("place index is not carried over"), std::string::npos) << err_.str();
  EXPECT_NE(err_.str().find("--index"), std::string::npos) << err_.str();
  EXPECT_FALSE(fs::exists(folder_ / "new/index"));
  expect_accepted("@new");
}

TEST_F(UpdatedIndex, ThatIsMissingOrDamagedIsNamed) {
  maker_.make(folder_, "old");
  EXPECT_EQ(update("@old", "@new", {"--index"}), 2);
  EXPECT_NE(err_.str().find("nadir cache index NEW"), std::string::npos) << err_.str();
  ASSERT_EQ(index("@old"), 0) << err_.str();
  Bytes table = read_file(folder_ / "old" / kPlaceTableFile);
  table[table.size() / 2] ^= 1;
  write_file_atomic(folder_ / "old" / kPlaceTableFile, table);
  EXPECT_NE(update("@old", "@new", {"--index"}), 0);
  EXPECT_FALSE(fs::exists(folder_ / "new"));
}

// The tiles alone, with what is appended to one of them, stay 0.1 MB below; an index has 0.3 MB at least.
TEST_F(UpdatedIndex, CountsTowardsTheBudget) {
  maker_.make(folder_, "lean");
  std::uintmax_t size = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder_ / "lean")) {
    if (entry.is_regular_file()) size += entry.file_size();
  }
  const std::uintmax_t budget_mb = size / 1'000'000 + 1;
  bool padded = false;
  maker_.edit_tile = [&](Sidecar&, Bytes& tile) {
    const std::uintmax_t left = budget_mb * 1'000'000 - size;
    if (!padded && left > 100'000) tile.resize(tile.size() + left - 100'000);  // behind the JPEG's end
    padded = true;
    return true;
  };
  maker_.make(folder_, "old");
  ASSERT_EQ(index("@old"), 0) << out_.str() << err_.str();
  folder_.write("next.yaml", test::mission_yaml({{"sequence: 3", "sequence: 4"},
                                                 {"budget_mb: 20", "budget_mb: " + std::to_string(budget_mb)}}));
  EXPECT_EQ(update("@old", "@without", {}), 0) << out_.str();
  EXPECT_EQ(update("@old", "@new", {"--index"}), 1) << out_.str() << err_.str();
  EXPECT_NE(out_.str().find("budget.exceeded"), std::string::npos) << out_.str();
  EXPECT_FALSE(fs::exists(folder_ / "new"));
}

}  // namespace
}  // namespace nadir
