#include "package/open_package.hpp"

#include <gtest/gtest.h>

#include "package/package_maker.hpp"

namespace nadir {
namespace {

using test::PackageMaker;
using test::TemporaryFolder;

class OpenedPackage : public ::testing::Test {
 protected:
  Opening open(const std::filesystem::path& package) {
    NoProgress progress;
    return open_package(package, maker_.options(), progress);
  }
  TemporaryFolder folder_;
  PackageMaker maker_;
};

TEST_F(OpenedPackage, ReturnsTilesAndSidecars) {
  const Opening opening = open(maker_.make(folder_));
  ASSERT_TRUE(opening.package) << test::codes(opening.findings);
  const CheckedTiles& tiles = opening.package->imagery();
  EXPECT_EQ(tiles.zooms().min, 17);
  EXPECT_EQ(tiles.zooms().max, 18);
  EXPECT_EQ(opening.package->mission().series, "village");
  for (const Sidecar& sidecar : tiles.sidecars()) {
    const auto tile = tiles.read(sidecar.key);
    ASSERT_TRUE(tile);
    EXPECT_EQ(sha256(*tile), sidecar.sha256);
    EXPECT_EQ(tiles.sidecar(sidecar.key)->captured_at, sidecar.captured_at);
    EXPECT_FALSE(tiles.read_mask(sidecar.key));
  }
  EXPECT_FALSE(tiles.read({18, 0, 0}));
  EXPECT_EQ(tiles.sidecar({18, 0, 0}), nullptr);
  EXPECT_TRUE(tiles.findings().empty());
}

// Quick verification does not hash tiles; reading does.
TEST_F(OpenedPackage, ReadsATamperedTileAsMissing) {
  const auto package = maker_.make(folder_);
  test::sqlite(package / kImageryFile, "UPDATE tiles SET tile_data = zeroblob(length(tile_data)) WHERE rowid = 3");
  const Opening opening = open(package);
  ASSERT_TRUE(opening.package) << test::codes(opening.findings);
  const CheckedTiles& tiles = opening.package->imagery();
  EXPECT_FALSE(tiles.read(tiles.sidecars()[2].key));
  EXPECT_TRUE(tiles.read(tiles.sidecars()[1].key));
  EXPECT_EQ(test::codes(tiles.findings()), "artifact.hash");
}

TEST_F(OpenedPackage, DoesNotReturnSwappedTiles) {
  maker_.edit_tile = [](Sidecar&, Bytes& tile) {
    tile.resize(100'000, 0);  // all of one length, so that the file keeps its size
    return true;
  };
  const auto package = maker_.make(folder_);
  test::sqlite(package / kImageryFile,
               "CREATE TEMP TABLE t AS SELECT rowid AS i, tile_data FROM tiles LIMIT 2;"
               "UPDATE tiles SET tile_data = (SELECT tile_data FROM t WHERE i <> tiles.rowid) WHERE rowid <= 2");
  const Opening opening = open(package);
  ASSERT_TRUE(opening.package);
  EXPECT_FALSE(opening.package->imagery().read(opening.package->imagery().sidecars()[0].key));
  EXPECT_FALSE(opening.package->imagery().read(opening.package->imagery().sidecars()[1].key));
}

TEST_F(OpenedPackage, ARejectedPackageIsNotOpened) {
  const auto package = maker_.make(folder_);
  std::filesystem::remove(package / kSignatureFile);
  const Opening opening = open(package);
  EXPECT_FALSE(opening.package);
  EXPECT_TRUE(opening.findings.contains("signature.missing"));
}

}  // namespace
}  // namespace nadir
