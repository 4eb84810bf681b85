#include <gtest/gtest.h>

#include <fstream>
#include <set>

#include "base/error.hpp"
#include "base/files.hpp"
#include "package_build/package_builder_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::PackageBuilder;
using test::ResumedBuild;

TEST_F(PackageBuilder, AKilledBuildLeavesNoPackageAndTheNextOneWorks) {
  build_and_kill(request("package"), kFirstTiles);
  EXPECT_FALSE(fs::exists(folder_ / "package"));
  EXPECT_FALSE(build(request("package")).findings.refuses());
  EXPECT_THAT(left_behind(), testing::ElementsAre("package"));
}

class ResumedBuildOf : public ResumedBuild, public testing::WithParamInterface<TileSetKind> {
 protected:
  PackageRequest in_container(PackageRequest wanted) const {
    wanted.tiles.container = GetParam();
    return wanted;
  }
  PackageRequest fresh(const std::string& out, int threads = 2) { return in_container(request(out, threads)); }
  PackageRequest resumed(const std::string& out, int threads = 2) { return in_container(resuming(out, threads)); }
};
INSTANTIATE_TEST_SUITE_P(Containers, ResumedBuildOf, testing::Values(TileSetKind::mbtiles, TileSetKind::cog),
                         [](const auto& kind) { return kind.param == TileSetKind::cog ? "Cog" : "Mbtiles"; });

// The progress is told after each metatile and around each later step.
TEST_P(ResumedBuildOf, EndsIdenticalWhereverItWasKilled) {
  const auto whole = run_build(fresh("whole"), 0);
  ASSERT_EQ(whole.code, 0) << whole.err;
  const int events = std::stoi(whole.out), last_tiles = events - 6;
  ASSERT_GT(last_tiles, kFirstTiles + 1);
  std::set<int> moments{1, kFirstTiles, (kFirstTiles + last_tiles) / 2};
  for (int event = last_tiles; event < events; ++event) moments.insert(event);
  for (const int event : moments) {
    const int threads = 1 + event % 3;
    build_and_kill(fresh("package", threads), event);
    EXPECT_FALSE(fs::exists(folder_ / "package")) << event;
    if (event == last_tiles) build_and_kill(resumed("package", threads), kFirstTiles);  // may happen as well
    const PackageReport report = build(resumed("package"));
    ASSERT_FALSE(report.findings.refuses());
    // From the first metatile until the journal is removed, right before the commit.
    EXPECT_EQ(report.resumed > 0, event >= kFirstTiles && event < events - 1) << event;
    expect_same_files(folder_ / "whole", folder_ / "package");
    EXPECT_THAT(left_behind(), testing::UnorderedElementsAre("whole", "package")) << event;
    fs::remove_all(folder_ / "package");
  }
  build_and_kill(fresh("package"), events);  // right after the commit: the lock stays, and stops nobody
  expect_same_files(folder_ / "whole", folder_ / "package");
  EXPECT_THAT(left_behind(), testing::UnorderedElementsAre("whole", "package", ".package.lock"));
}

TEST_F(ResumedBuild, TakesMetatilesFromTheJournal) {
  build_and_kill(request("package"), kFirstTiles);
  EXPECT_FALSE(fs::exists(folder_ / "package"));
  const PackageReport report = build(resuming("package"));
  EXPECT_GT(report.resumed, 0);
  EXPECT_THAT(remarks_, testing::IsEmpty());
  ASSERT_FALSE(build(request("whole")).findings.refuses());
  expect_same_files(folder_ / "whole", folder_ / "package");
}

TEST_F(ResumedBuild, OtherInputsOrOptionsAreRefusedAndNothingIsLost) {
  build_and_kill(request("package"), kFirstTiles);
  PackageRequest other = resuming("package");
  other.tiles.encoding.quality = 60;
  EXPECT_THROW(build(other), UsageError);
  other = resuming("package");
  other.overrides.gsd_m = 0.31;
  EXPECT_THROW(build(other), UsageError);
  other = resuming("package");
  other.key = nullptr;
  EXPECT_THROW(build(other), UsageError);
  const Bytes map = read_file(folder_ / "map.tif");
  write_map("map.tif", {209, 190, 150});
  EXPECT_THROW(build(resuming("package")), UsageError);
  std::ofstream(folder_ / "map.tif", std::ios::binary)
      .write(as_text(map).data(), static_cast<std::streamsize>(map.size()));
  EXPECT_GT(build(resuming("package")).resumed, 0);
}

TEST_F(ResumedBuild, WithoutResumeItBeginsAnewAndSaysSo) {
  build_and_kill(request("package"), kFirstTiles);
  PackageRequest anew = resuming("package");
  anew.resume = false;
  EXPECT_EQ(build(anew).resumed, 0);
  EXPECT_THAT(remarks_, testing::ElementsAre(testing::HasSubstr("--resume")));
  remarks_.clear();
  EXPECT_EQ(build(resuming("another")).resumed, 0);
  EXPECT_THAT(remarks_, testing::ElementsAre(testing::HasSubstr("nothing to resume")));
}

}  // namespace
}  // namespace nadir
