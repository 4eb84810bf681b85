#include <gtest/gtest.h>

#include <fstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "imagery/codecs.hpp"
#include "package_build/package_builder_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::PackageBuilder;

TEST_F(PackageBuilder, AHoleInTheRequiredAreaIsAGap) {
  spec_.nodata = 0;
  hole_ = [](int column, int row) { return std::hypot(column - 800, row - 700) < 20; };
  write_map("map.tif");
  expect_refused(request("package"), "coverage.gap");
}

TEST_F(PackageBuilder, ImageryThatEndsTooEarlyIsAGap) {
  spec_.width = 1000;
  write_map("map.tif");
  expect_refused(request("package"), "coverage.gap");
  (*spec_.transform)[0] += 50'000;  // somewhere else
  write_map("map.tif");
  expect_refused(request("package"), "coverage.gap");
}

TEST_F(PackageBuilder, RefusesStaleCoarseAndLargeOnes) {
  write_mission(200);
  expect_refused(request("package"), "freshness.stale");
  write_mission(400);
  PackageRequest late = request("package");
  late.at = parse_utc("2024-11-29T00:00:00Z");
  write_mission(260);
  expect_refused(late, "freshness.stale");
  late.at = parse_utc("2024-12-01T00:00:00Z");
  write_mission(4000);
  expect_refused(late, "package.expired");
  write_mission(400, 1);
  test::write_item(folder_ / "map.tif", "2024-03-01T00:00:00Z", 0.8);
  expect_refused(request("package"), "resolution.coarse");
  test::write_item(folder_ / "map.tif");
  PackageRequest large = request("package");
  large.tiles.encoding = {ImageFormat::png, 75};
  hole_ = nullptr;
  test::write_raster(folder_ / "map.tif", spec_, [](int column, int row) -> std::array<int, 4> {
    const int noise = (column * 7919 + row * 104729 + column * row * 31) % 256;
    return {noise, (noise * 7) % 256, (noise * 13) % 256, 255};
  });
  expect_refused(large, "budget.exceeded");
}

TEST_F(PackageBuilder, ErrorsLeaveNothing) {
  PackageRequest bad = request("package");
  bad.imagery = {folder_ / "missing.tif"};
  EXPECT_THROW(build(bad), Error);
  bad = request("package");
  bad.mission = folder_ / "missing.yaml";
  EXPECT_THROW(build(bad), Error);
  // Damage that shows only when the pixels are read.
  spec_.tiled = true;
  write_map("map.tif");
  const Bytes whole = read_file(folder_ / "map.tif");
  std::ofstream(folder_ / "map.tif", std::ios::binary)
      .write(as_text(whole).data(), static_cast<std::streamsize>(whole.size() * 6 / 10));
  EXPECT_THROW(build(request("package")), Error);
  EXPECT_THAT(left_behind(), testing::IsEmpty());
  fs::create_directory(folder_ / "package");
  write_map("map.tif");
  EXPECT_THROW(build(request("package")), Error);  // never replaces
}

TEST_F(PackageBuilder, ZoomsThatCannotBeCountedAreRefused) {
  std::string text = read_text_file(folder_ / "mission.yaml");
  text.replace(text.find("max: 19"), 7, "max: 23");
  folder_.write("mission.yaml", text);
  EXPECT_THROW(build(request("package")), UsageError);
}

class StopAtOnce final : public Progress {
 public:
  void begin(std::string_view, std::uint64_t, std::string_view) override {}
  void advance(std::uint64_t) override { throw Interrupted(); }
  void end() override {}
};

TEST_F(PackageBuilder, AnInterruptedBuildLeavesNothing) {
  StopAtOnce progress;
  EXPECT_THROW(build_package(request("package"), progress), Interrupted);
  EXPECT_THAT(left_behind(), testing::IsEmpty());
}

}  // namespace
}  // namespace nadir
