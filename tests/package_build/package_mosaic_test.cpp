#include <fmt/format.h>
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "package_build/package_builder_fixture.hpp"

namespace nadir {
namespace {

using test::PackageBuilder;

TEST_F(PackageBuilder, TheFirstRasterLiesOnTop) {
  write_map("old.tif", {255, 0, 0});
  test::write_item(folder_ / "old.tif", "2023-12-01T00:00:00Z", 0.4, "archive");
  spec_.width = 800;  // the new one covers the western half
  write_map("map.tif");
  PackageRequest both = request("package");
  both.imagery = {folder_ / "map.tif", folder_ / "old.tif"};
  ASSERT_FALSE(build(both).findings.refuses());
  const auto sources = test::run_process({"sqlite3", (both.out / kImageryFile).string(),
                                          "SELECT DISTINCT source, substr(captured_at, 1, 10), gsd_mm FROM "
                                          "nadir_sidecars WHERE zoom_level = 19 ORDER BY 1"});
  EXPECT_EQ(sources.out, "archive|2023-12-01|400\narchive + survey|2023-12-01|400\nsurvey|2024-03-01|300\n");
}

TEST_F(PackageBuilder, TheNewestOrFinestLiesOnTopWhenAskedFor) {
  write_map("old.tif");
  test::write_item(folder_ / "old.tif", "2023-12-01T00:00:00Z", 0.28, "archive");
  for (const auto& [order, source] :
       {std::pair{MosaicOrder::priority, "archive\n"}, std::pair{MosaicOrder::newest, "survey\n"},
        std::pair{MosaicOrder::finest, "archive\n"}}) {
    PackageRequest both = request(fmt::format("map.{}", static_cast<int>(order)));
    both.imagery = {folder_ / "old.tif", folder_ / "map.tif"};
    both.tiles.mosaic.order = order;
    ASSERT_FALSE(build(both).findings.refuses());
    const auto sources = test::run_process(
        {"sqlite3", (both.out / kImageryFile).string(), "SELECT DISTINCT source FROM nadir_sidecars"});
    EXPECT_EQ(sources.out, source);
  }
}

TEST_F(PackageBuilder, FeatheredSeamsAreTheSameForAnyNumberOfThreadsAndNotWithoutLimit) {
  write_map("old.tif", {255, 0, 0});
  spec_.width = 800;
  write_map("map.tif");
  PackageRequest both = request("map.1", 1);
  both.imagery = {folder_ / "map.tif", folder_ / "old.tif"};
  both.tiles.mosaic.feather_m = 8;
  ASSERT_FALSE(build(both).findings.refuses());
  both.out = folder_ / "map.3";
  both.tiles.threads = 3;
  ASSERT_FALSE(build(both).findings.refuses());
  expect_same_files(folder_ / "map.1", folder_ / "map.3");
  both.out = folder_ / "map.far";
  both.tiles.mosaic.feather_m = 500;
  EXPECT_THROW(build(both), UsageError);
}

}  // namespace
}  // namespace nadir
