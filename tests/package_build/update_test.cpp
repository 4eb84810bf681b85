// Which tiles an update makes anew, and what is in them: against arithmetic, `cache diff` and whole builds.
#include <opencv2/core.hpp>

#include "imagery/codecs.hpp"
#include "imagery/mbtiles_reader.hpp"
#include "package/tile_set_diff.hpp"
#include "package/verify.hpp"
#include "package_build/update_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::PackageUpdate;

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

TEST_F(UpdatedPackage, ReencodesExactlyWhatNewImageryTouches) {
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.refuses());
  const UpdateReport report = update(request({"patch.tif"}));
  ASSERT_FALSE(report.package.findings.refuses());
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

TEST_F(UpdatedPackage, SidecarsSayWhatABuildFromBothSays) {
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.refuses());
  ASSERT_FALSE(update(request({"patch.tif"})).package.findings.refuses());
  ASSERT_FALSE(build("both", "new.yaml", {"old.tif", "patch.tif"}).findings.refuses());
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

TEST_F(UpdatedPackage, PixelsAreThoseOfABuildFromBothButForJpegsError) {
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.refuses());
  ASSERT_FALSE(update(request({"patch.tif"})).package.findings.refuses());
  ASSERT_FALSE(build("both", "new.yaml", {"old.tif", "patch.tif"}).findings.refuses());
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
TEST_F(UpdatedPackage, WithPngItIsTheBuildFromBothByteForByte) {
  write_map("old.tif", {0, 0, 2560, 2560}, 0, "2024-03-01T00:00:00Z", "archive", cv::Rect(100, 100, 300, 500));
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}, ImageFormat::png).findings.refuses());
  ASSERT_FALSE(update(request({"patch.tif"})).package.findings.refuses());
  ASSERT_FALSE(build("both", "new.yaml", {"old.tif", "patch.tif"}, ImageFormat::png).findings.refuses());
  expect_same_files(folder_ / "new", folder_ / "both");
}

TEST_F(UpdatedPackage, ImageryThatCoversEverythingGivesTheBytesOfABuild) {
  write_map("all.tif", {0, 0, 2560, 2560}, 2, "2024-09-01T00:00:00Z", "survey");
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.refuses());
  const UpdateReport report = update(request({"all.tif"}));
  EXPECT_EQ(report.counts.copied, 0U);
  ASSERT_FALSE(build("alone", "new.yaml", {"all.tif"}).findings.refuses());
  expect_same_files(folder_ / "new", folder_ / "alone");
}

TEST_F(UpdatedPackage, SameBytesForAnyNumberOfThreadsHardAndFeathered) {
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.refuses());
  for (const double feather_m : {0.0, 6.0}) {
    for (const int threads : {1, 3}) {
      UpdateRequest wanted = request({"patch.tif"}, fmt::format("new{}.{}", feather_m, threads));
      wanted.tiles.threads = threads;
      wanted.tiles.mosaic.feather_m = feather_m;
      ASSERT_FALSE(update(wanted).package.findings.refuses());
    }
    expect_same_files(folder_ / fmt::format("new{}.1", feather_m), folder_ / fmt::format("new{}.3", feather_m));
  }
  EXPECT_FALSE(diff("new0.1", "new6.1").empty()) << "seams differ";
}

TEST_F(UpdatedPackage, OlderImageryOnlyFillsHolesUnlessItHasPriority) {
  const cv::Rect hole(20, 30, 200, 100);
  write_map("old.tif", {0, 0, 2560, 2560}, 0, "2024-03-01T00:00:00Z", "archive", hole);
  write_map("older.tif", {0, 0, 1000, 300}, 1, "2024-02-01T00:00:00Z", "survey");
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.refuses());
  const UpdateReport report = update(request({"older.tif"}));
  ASSERT_FALSE(report.package.findings.refuses());
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
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}, ImageFormat::png).findings.refuses());
  ASSERT_FALSE(update(request({"patch.tif"})).package.findings.refuses());
  UpdateRequest next = request({"second.tif"}, "third");
  next.old_package = folder_ / "new";
  next.mission = folder_ / "third.yaml";
  ASSERT_FALSE(update(next).package.findings.refuses());
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
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.refuses());
  write_mission("new.yaml", 2, 0, 1);
  const UpdateReport report = update(request({}));
  ASSERT_FALSE(report.package.findings.refuses());
  const TileSetDiff found = diff("old", "new");
  EXPECT_EQ(report.counts.dropped, found.removed.size());
  EXPECT_GT(report.counts.dropped, 20U);
  EXPECT_EQ(report.counts.reencoded + report.counts.added, 0U);
  EXPECT_TRUE(found.added.empty() && found.changed.empty());
  expect_accepted("new");
}

TEST_F(UpdatedPackage, ALargerMissionNeedsImageryForWhatItAdds) {
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.refuses());
  write_mission("new.yaml", 2, 6, 11);
  expect_refused(request({}), "coverage.gap");
  write_map("east.tif", {2300, 0, 1024, 2560}, 1, "2024-09-01T00:00:00Z", "survey");
  const UpdateReport report = update(request({"east.tif"}));
  ASSERT_FALSE(report.package.findings.refuses());
  const TileSetDiff found = diff("old", "new");
  EXPECT_EQ(report.counts.added, found.added.size());
  EXPECT_EQ(report.counts.reencoded, found.changed.size());
  EXPECT_EQ(report.counts.dropped, found.removed.size());
  EXPECT_GT(report.counts.added, 20U);
  expect_accepted("new");
}

TEST_F(UpdatedPackage, SectorsAreThoseOfTheNewMission) {
  ASSERT_FALSE(build("old", "old.yaml", {"old.tif"}).findings.refuses());
  write_mission("new.yaml", 2, 3, 6, {{"id: middle", "id: centre"}});
  ASSERT_FALSE(update(request({})).package.findings.refuses());
  std::set<std::string> sectors;
  for (const Sidecar& tile : sidecars("new")) sectors.insert(tile.sector);
  EXPECT_THAT(sectors, testing::ElementsAre("", "centre"));
}

}  // namespace
}  // namespace nadir
