// nadir cache diff as a user calls it.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "commands/command_fixture.hpp"
#include "package/package_maker.hpp"
#include "support/process.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class CacheDiff : public test::CommandTest {
 protected:
  int diff(const fs::path& a, const fs::path& b, bool as_json = false) {
    std::vector<std::string> args{"cache", "diff", a.string(), b.string()};
    if (as_json) args.push_back("--json");
    return run(std::move(args));
  }
  json diff_json(const fs::path& a, const fs::path& b) {
    diff(a, b, true);
    return json::parse(out_.str());
  }
};

TEST_F(CacheDiff, APackageEqualsItself) {
  const fs::path package = maker_.make(folder_);
  EXPECT_EQ(diff(package, package), 0) << out_.str() << err_.str();
  EXPECT_EQ(diff(package, package / kImageryFile), 0) << "a package and its tile set hold the same tiles";
  EXPECT_TRUE(diff_json(package, package)["same"].get<bool>());
  EXPECT_TRUE(err_.str().empty());
}

TEST_F(CacheDiff, NamesAddedRemovedAndChangedTilesWithTheirDigests) {
  const fs::path a = maker_.make(folder_, "a") / kImageryFile;
  const fs::path b = folder_ / "b.mbtiles", bytes = folder_ / "tile";
  fs::copy_file(a, b);
  // The first tile of zoom 18 goes, the second gets other bytes, one appears far away.
  const auto rows =
      test::run_process({"sqlite3", a.string(),
                         "SELECT zoom_level || '/' || tile_column || '/' || ((1 << zoom_level) - 1 - tile_row), rowid"
                         " FROM tiles WHERE zoom_level = 18 ORDER BY tile_column, tile_row DESC LIMIT 2"});
  const std::string first = rows.out.substr(0, rows.out.find('|'));
  const std::string second = rows.out.substr(rows.out.find('\n') + 1, rows.out.rfind('|') - rows.out.find('\n') - 1);
  const std::string key = "FROM tiles WHERE zoom_level = 18 ORDER BY tile_column, tile_row DESC LIMIT 1";
  test::sqlite(b, "DELETE FROM tiles WHERE rowid = (SELECT rowid " + key +
                      ");"
                      "UPDATE tiles SET tile_data = x'c0ffee' WHERE rowid = (SELECT rowid " +
                      key +
                      ");"
                      "INSERT INTO tiles VALUES (18, 5, 7, x'00');"
                      "UPDATE metadata SET value = 'another' WHERE name = 'name';"
                      "INSERT INTO metadata VALUES ('attribution', 'x')");
  EXPECT_EQ(diff(a, b), 1);
  const json found = diff_json(a, b);
  EXPECT_FALSE(found["same"].get<bool>());
  ASSERT_EQ(found["removed"].size(), 1U);
  EXPECT_EQ(found["removed"][0]["tile"], first);
  ASSERT_EQ(found["changed"].size(), 1U);
  EXPECT_EQ(found["changed"][0]["tile"], second);
  // openssl's word for the digests
  const auto digest = test::run_shell("printf '\\xc0\\xff\\xee' | openssl dgst -sha256 -r");
  EXPECT_EQ(found["changed"][0]["after"], digest.out.substr(0, 64));
  ASSERT_EQ(found["added"].size(), 1U);
  EXPECT_EQ(found["added"][0]["tile"], "18/5/" + std::to_string((1 << 18) - 1 - 7));
  EXPECT_EQ(found["metadata"].size(), 2U) << found["metadata"];
  // The other way round it is the mirror image.
  const json back = diff_json(b, a);
  EXPECT_EQ(back["added"][0]["tile"], first);
  EXPECT_EQ(back["changed"][0]["before"], found["changed"][0]["after"]);
}

TEST_F(CacheDiff, TheSummaryComesFirstAndTheMapOfChangesIsGeoJson) {
  const fs::path a = maker_.make(folder_, "a");
  maker_.edit_tile = [](Sidecar& sidecar, Bytes&) { return sidecar.key.z != 18; };
  const fs::path b = maker_.make(folder_, "b");
  EXPECT_EQ(run({"cache", "diff", a.string(), b.string(), "--geojson", path("diff.geojson")}), 1);
  EXPECT_TRUE(out_.str().starts_with("different: 0 tiles added")) << out_.str();
  EXPECT_NE(out_.str().find("zoom 18:"), std::string::npos) << out_.str();
  EXPECT_EQ(out_.str().find("- tile 18/"), std::string::npos) << "tiles are listed on request";
  const json map = json::parse(read_text_file(path("diff.geojson")));
  ASSERT_FALSE(map["features"].empty());
  EXPECT_EQ(map["features"][0]["properties"]["change"], "removed");
  EXPECT_EQ(test::run_process({"ogrinfo", "-so", "-al", path("diff.geojson")}).code, 0);
  EXPECT_EQ(run({"cache", "diff", a.string(), b.string(), "--list"}), 1);
  EXPECT_NE(out_.str().find("- tile 18/"), std::string::npos);
}

TEST_F(CacheDiff, ComparesManifestsAndSidecars) {
  const fs::path a = maker_.make(folder_, "a");
  maker_.mission = test::mission_yaml({{"sequence: 3", "sequence: 4"}});
  maker_.edit_tile = [](Sidecar& sidecar, Bytes&) {
    if (sidecar.key.z == 17) sidecar.captured_at.unix_s += 86'400;
    return true;
  };
  const fs::path b = maker_.make(folder_, "b");
  const json found = diff_json(a, b);
  EXPECT_TRUE(found["added"].empty() && found["removed"].empty() && found["changed"].empty());
  EXPECT_FALSE(found["sidecars"].empty());
  for (const json& tile : found["sidecars"]) EXPECT_EQ(tile.get<std::string>().substr(0, 3), "17/");
  EXPECT_NE(found["manifest"].dump().find(R"({"after":"4","before":"3","name":"sequence"})"), std::string::npos)
      << found["manifest"];
}

TEST_F(CacheDiff, InputsThatCannotBeComparedAreAnError) {
  const fs::path package = maker_.make(folder_);
  EXPECT_EQ(diff(package, folder_ / "none"), 2);
  folder_.write("text.mbtiles", "no database");
  EXPECT_EQ(diff(package, folder_ / "text.mbtiles"), 2);
  fs::create_directory(folder_ / "empty");
  EXPECT_EQ(diff(folder_ / "empty", package), 2);
  const fs::path bad = folder_ / "bad.mbtiles";
  fs::copy_file(package / kImageryFile, bad);
  test::sqlite(bad, "INSERT INTO tiles VALUES (99, 1, 1, x'00')");
  EXPECT_EQ(diff(package, bad), 2);
  EXPECT_NE(err_.str().find("99"), std::string::npos) << err_.str();
  EXPECT_TRUE(out_.str().empty());
}

TEST_F(CacheDiff, NamesInFilesAreEscapedForTheTerminal) {
  const fs::path a = maker_.make(folder_, "a") / kImageryFile, b = folder_ / "b.mbtiles";
  fs::copy_file(a, b);
  test::sqlite(b, "INSERT INTO metadata VALUES ('x' || char(27) || '[31m', char(27) || ']0;owned' || char(7))");
  EXPECT_EQ(diff(a, b), 1);
  EXPECT_EQ(out_.str().find('\x1b'), std::string::npos);
  EXPECT_NE(out_.str().find("metadata x"), std::string::npos);
}

// As a planner and an operator call them.
TEST_F(CacheDiff, APatchMakesTheOtherPackage) {
  maker_.make(folder_, "old");
  folder_.write("root.json", sign_root(maker_.root, {&maker_.signer}).json());
  write_file_atomic(folder_ / "p.key.pem", maker_.signer.pem(), 0600);
  write_file_atomic(folder_ / "other.pem", PrivateKey::generate().pem(), 0600);
  maker_.mission = test::mission_yaml({{"sequence: 3", "sequence: 4"}});
  maker_.make(folder_, "new");
  const std::vector<std::string> patch{"cache", "diff", "@old", "@new", "--patch", "@patch", "--trust", "@root.json"};
  const auto with_key = [&](const std::string& key) {
    std::vector<std::string> args = patch;
    args.insert(args.end(), {"--key", key});
    return args;
  };
  EXPECT_EQ(run(with_key("@other.pem")), 2);
  EXPECT_EQ(run(patch), 2);
  EXPECT_FALSE(fs::exists(folder_ / "patch"));
  ASSERT_EQ(run(with_key("@p.key.pem")), 0) << err_.str();
  EXPECT_NE(out_.str().find("patch: "), std::string::npos) << out_.str();
  const std::vector<std::string> apply{"cache", "apply", "@old", "@patch", "--trust", "@root.json", "--out", "@made"};
  ASSERT_EQ(run(apply), 0) << err_.str();
  EXPECT_NE(out_.str().find("3 -> 4"), std::string::npos) << out_.str();
  EXPECT_EQ(test::run_process({"diff", "-r", path("new"), path("made")}).code, 0);
  EXPECT_EQ(run(apply), 2) << "it is there already";
  EXPECT_EQ(run({"cache", "apply", "@old", "@patch", "--trust", "@root.json", "--out", "@late", "--at", "2026-01-01",
                 "--json"}),
            1);
  EXPECT_EQ(result()["findings"][0]["code"], "package.expired");
  EXPECT_FALSE(fs::exists(folder_ / "late"));
}

}  // namespace
}  // namespace nadir
