// nadir cache export as a user calls it. What other programs say about the files: tests/third_party.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <fstream>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "commands/command_fixture.hpp"
#include "package/open_package.hpp"
#include "package_build/die_at.hpp"
#include "package_export/tile_export.hpp"
#include "support/process.hpp"
#include "support/small_disk.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

const std::vector<std::string> kFormats{"pmtiles", "gpkg", "mbtiles", "xyz", "mission-planner"};

class CacheExport : public test::CommandTest {
 protected:
  CacheExport() {
    maker_.make(folder_);
    write_file_atomic(folder_ / "root.json", sign_root(maker_.root, {&maker_.signer}).json());
  }
  int export_as(const std::string& format, const std::string& out = "out") {
    return run(
        {"cache", "export", "@package", "--format", format, "--trust", "@root.json", "--out", "@" + out, "--json"});
  }
  // Nothing but what the test made.
  std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_ / ".")) names.push_back(entry.path().filename());
    std::sort(names.begin(), names.end());
    return names;
  }
  std::string sql(const std::string& query) {
    const auto result = test::run_process({"sqlite3", path("out"), query});
    EXPECT_EQ(result.code, 0) << result.err;
    return result.out;
  }
};

TEST_F(CacheExport, EveryFormatHoldsEveryTile) {
  const auto tiles = static_cast<std::uint64_t>(maker_.verify(folder_ / "package").tiles.size());
  for (const std::string& format : kFormats) {
    ASSERT_EQ(export_as(format), 0) << format << out_.str() << err_.str();
    EXPECT_EQ(result()["tiles"], tiles) << format;
    EXPECT_TRUE(fs::exists(folder_ / "out"));
    EXPECT_EQ(names(), (std::vector<std::string>{"out", "package", "root.json"})) << format;
    if (format == "pmtiles" || format == "mbtiles") {
      // The same tiles by the programs' own reader, metadata apart.
      run({"cache", "diff", "@package/imagery/base.mbtiles", "@out", "--json"});
      const auto diff = result();
      EXPECT_EQ(diff["unchanged_tiles"], tiles) << format << diff.dump();
      EXPECT_TRUE(diff["added"].empty() && diff["removed"].empty() && diff["changed"].empty());
    }
    EXPECT_EQ(export_as(format), 2) << "never overwritten";
    fs::remove_all(folder_ / "out");
  }
}

TEST_F(CacheExport, TheSamePackageGivesTheSameBytes) {
  for (const std::string& format : kFormats) {
    ASSERT_EQ(export_as(format, "out"), 0);
    ASSERT_EQ(export_as(format, "again"), 0);
    EXPECT_EQ(test::run_process({"diff", "-r", path("out"), path("again")}).code, 0) << format;
    fs::remove_all(folder_ / "out");
    fs::remove_all(folder_ / "again");
  }
}

TEST_F(CacheExport, ACogExportsTheSameFilesAsMbtiles) {
  maker_.cog = true;
  maker_.make(folder_, "cog");
  for (const std::string& format : kFormats) {
    ASSERT_EQ(export_as(format), 0) << err_.str();
    ASSERT_EQ(run({"cache", "export", "@cog", "--format", format, "--trust", "@root.json", "--out", "@of-cog"}), 0)
        << err_.str();
    EXPECT_EQ(test::run_process({"diff", "-r", path("out"), path("of-cog")}).code, 0) << format;
    fs::remove_all(folder_ / "out");
    fs::remove_all(folder_ / "of-cog");
  }
}

TEST_F(CacheExport, RowsOfAGeopackageCountFromTheNorth) {
  ASSERT_EQ(export_as("gpkg"), 0);
  EXPECT_EQ(sql("PRAGMA application_id; PRAGMA user_version; PRAGMA integrity_check; PRAGMA foreign_key_check"),
            "1196444487\n10300\nok\n");
  const std::string first = test::run_process({"sqlite3", path("package/imagery/base.mbtiles"),
                                               "SELECT zoom_level, tile_column, (1 << zoom_level) - 1 - tile_row,"
                                               " hex(tile_data) FROM tiles ORDER BY 1, 2, 3"})
                                .out;
  EXPECT_EQ(sql("SELECT zoom_level, tile_column, tile_row, hex(tile_data) FROM imagery ORDER BY 1, 2, 3"), first);
  EXPECT_EQ(sql("SELECT data_type, identifier, last_change, srs_id FROM gpkg_contents"),
            "tiles|village-a|2024-04-20T00:00:00.000Z|3857\n");
}

TEST_F(CacheExport, ARejectedPackageLeavesNothing) {
  test::sqlite(folder_ / "package" / kImageryFile,
               "UPDATE tiles SET tile_data = x'00' WHERE rowid = (SELECT max(rowid) FROM tiles)");
  for (const std::string& format : kFormats) {
    EXPECT_EQ(export_as(format), 1);
    EXPECT_THAT(out_.str(), HasSubstr("artifact."));
    EXPECT_EQ(names(), (std::vector<std::string>{"package", "root.json"})) << format;
  }
  EXPECT_EQ(run({"cache", "export", "@package", "--format", "xyz", "--trust", "@root.json", "--at", "2024-07-01",
                 "--out", "@out"}),
            1);
  EXPECT_THAT(out_.str(), HasSubstr("package.expired"));
}

TEST_F(CacheExport, WhatCannotBeWrittenIsNamed) {
  EXPECT_EQ(run({"cache", "export", "@package", "--format", "kmz", "--trust", "@root.json", "--out", "@out"}), 2);
  EXPECT_EQ(run({"cache", "export", "@package", "--format", "xyz", "--trust", "@root.json", "--out", "@no/such/out"}),
            2);
  EXPECT_EQ(names(), (std::vector<std::string>{"package", "root.json"}));
}

TEST_F(CacheExport, KilledAnywhereItLeavesNothingUnderItsNameAndTheNextRunWorks) {
  const auto run_killed = [&](TileExportFormat format, int event) {
    test::DieAt progress(event);
    export_tiles({folder_ / "package", folder_ / "out", format, &maker_.root, test::kJudged}, progress);
    std::_Exit(0);
  };
  for (const TileExportFormat format : {TileExportFormat::pmtiles, TileExportFormat::gpkg, TileExportFormat::xyz}) {
    test::DieAt count(0);
    export_tiles({folder_ / "package", folder_ / "out", format, &maker_.root, test::kJudged}, count);
    fs::rename(folder_ / "out", folder_ / "whole");
    for (int event = 1; event <= count.seen(); event += 1 + count.seen() / 8) {
      EXPECT_EXIT(run_killed(format, event), ::testing::KilledBySignal(SIGKILL), "");
      EXPECT_FALSE(fs::exists(folder_ / "out")) << event;
    }
    EXPECT_EXIT(run_killed(format, count.seen()), ::testing::KilledBySignal(SIGKILL), "");
    EXPECT_FALSE(fs::exists(folder_ / "out"));
    NoProgress none;
    export_tiles({folder_ / "package", folder_ / "out", format, &maker_.root, test::kJudged}, none);
    EXPECT_EQ(test::run_process({"diff", "-r", path("out"), path("whole")}).code, 0);
    fs::remove_all(folder_ / "out");
    fs::remove_all(folder_ / "whole");
    EXPECT_EQ(names(), (std::vector<std::string>{"package", "root.json"}));
  }
}

TEST_F(CacheExport, AFullDiskLeavesNothing) {
  const test::SmallDisk disk(folder_ / "disk", "size=150k");
  if (!disk.mounted()) GTEST_SKIP() << "NOT TESTED: a small disk needs root";
  for (const std::string& format : kFormats) {
    EXPECT_EQ(export_as(format, "disk/out"), 2) << format;
    EXPECT_TRUE(fs::is_empty(folder_ / "disk")) << format;
  }
}

}  // namespace
}  // namespace nadir
