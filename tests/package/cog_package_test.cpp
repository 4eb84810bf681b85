// The attacks of verify_test.cpp on a package whose tiles lie in a COG, and flying with one.
#include <gtest/gtest.h>

#include <algorithm>

#include "imagery/cog_reader.hpp"
#include "package/open_package.hpp"
#include "package/verify_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::codes;

class CogPackage : public test::Verify {
 protected:
  CogPackage() { maker_.cog = true; }

  // Where the tile lies in the file.
  static std::size_t place_of(const fs::path& package, const TileKey& key) {
    const CogReader reader(package / kCogFile);
    const CogLevel& level = *reader.level(key.z);
    const std::int64_t column = std::int64_t{key.x} - level.west / kTileSize;
    const std::int64_t row = std::int64_t{key.y} - level.north / kTileSize;
    return static_cast<std::size_t>(
        level.picture.places[static_cast<std::size_t>(row * level.picture.across + column)]);
  }

  Opening open(const fs::path& package) {
    NoProgress progress;
    return open_package(package, maker_.options(), progress);
  }
};

TEST_F(CogPackage, IsAcceptedAtBothDepths) {
  const fs::path package = maker_.make(folder_);
  for (const VerifyDepth depth : {VerifyDepth::quick, VerifyDepth::full}) {
    const Verification result = maker_.verify(package, depth);
    EXPECT_TRUE(result.accepted()) << codes(result.findings);
    EXPECT_TRUE(result.findings.empty()) << codes(result.findings);
  }
}

TEST_F(CogPackage, HasTheTilesAndMerkleRootOfAnMbtilesPackage) {
  const Verification cog = maker_.verify(maker_.make(folder_, "cog"), VerifyDepth::full);
  maker_.cog = false;
  const Verification mbtiles = maker_.verify(maker_.make(folder_, "mbtiles"), VerifyDepth::full);
  const TileSetFacts &a = *cog.manifest->artifact(kRoleImagery)->tiles,
                     &b = *mbtiles.manifest->artifact(kRoleImagery)->tiles;
  EXPECT_EQ(a.merkle_root, b.merkle_root);
  EXPECT_EQ(a.sidecars_sha256, b.sidecars_sha256);
  EXPECT_EQ(a.count, b.count);
}

TEST_F(CogPackage, FullNamesTheTamperedTile) {
  const fs::path package = maker_.make(folder_);
  const TileKey key = maker_.verify(package).tiles[4].key;
  flip(package / kCogFile, place_of(package, key) + 700);
  const Verification result = maker_.verify(package, VerifyDepth::full);
  expect("artifact.hash", result);
  EXPECT_TRUE(std::any_of(result.findings.items().begin(), result.findings.items().end(), [&](const Finding& finding) {
    return finding.where.find("base.tif, tile " + to_text(key)) != std::string::npos;
  }));
}

TEST_F(CogPackage, DetectsSwappedTiles) {
  maker_.edit_tile = [](Sidecar&, Bytes& tile) {
    tile.resize(100'000, 0);  // all of one length, so that they can change places
    return true;
  };
  const fs::path package = maker_.make(folder_);
  const auto tiles = maker_.verify(package).tiles;
  const TileKey first = tiles[tiles.size() - 1].key, second = tiles[tiles.size() - 2].key;
  Bytes file = read_file(package / kCogFile);
  std::swap_ranges(file.begin() + static_cast<std::ptrdiff_t>(place_of(package, first)),
                   file.begin() + static_cast<std::ptrdiff_t>(place_of(package, first) + 100'000),
                   file.begin() + static_cast<std::ptrdiff_t>(place_of(package, second)));
  overwrite(package / kCogFile, file);
  expect("artifact.hash", maker_.verify(package, VerifyDepth::full));
  // With recomputed digests in the sidecars, as an attacker would do it: the sidecars are signed as well.
  const auto hex = [&](const Sidecar& tile) { return tile.sha256.hex(); };
  const auto at = [](const TileKey& key) {
    return " WHERE zoom_level = " + std::to_string(key.z) + " AND tile_column = " + std::to_string(key.x) +
           " AND tile_row = " + std::to_string(key.tms_row()) + ";";
  };
  test::sqlite(package / kSidecarFile, "UPDATE nadir_sidecars SET sha256 = x'" + hex(tiles[tiles.size() - 2]) + "'" +
                                           at(first) + "UPDATE nadir_sidecars SET sha256 = x'" +
                                           hex(tiles[tiles.size() - 1]) + "'" + at(second));
  expect("artifact.hash", maker_.verify(package));
}

TEST_F(CogPackage, RequiresSignedSidecars) {
  const fs::path gone = maker_.make(folder_, "gone");
  fs::remove(gone / kSidecarFile);
  expect("artifact.missing", maker_.verify(gone));
  const fs::path aged = maker_.make(folder_, "aged");
  test::sqlite(aged / kSidecarFile, "UPDATE nadir_sidecars SET captured_at = '2024-04-20T00:00:00Z'");
  expect("artifact.hash", maker_.verify(aged));
  // Signed without them: nothing may vouch for the tiles.
  maker_.edit_manifest = [](Manifest& manifest) { manifest.artifacts.pop_back(); };
  const fs::path bare = maker_.make(folder_, "bare");
  expect("artifact.unexpected", maker_.verify(bare));
  fs::remove(bare / kSidecarFile);
  expect("tiles.count", maker_.verify(bare));
}

// Each file is whole and honest by itself, but they do not belong together.
TEST_F(CogPackage, TilesRootForSidecarsOfAnotherSet) {
  maker_.edit_manifest = [](Manifest& manifest) { manifest.artifacts[0].tiles->merkle_root.bytes[0] ^= 1; };
  expect_only("tiles.root", maker_.verify(maker_.make(folder_)));
}

TEST_F(CogPackage, TruncatedIsRejected) {
  const fs::path package = maker_.make(folder_);
  const Bytes good = read_file(package / kCogFile);
  for (const std::size_t size : {std::size_t{0}, std::size_t{7}, std::size_t{300}, good.size() / 2, good.size() - 1}) {
    overwrite(package / kCogFile, {good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size)});
    expect("artifact.size", maker_.verify(package));
    const Verification full = maker_.verify(package, VerifyDepth::full);
    expect("artifact.size", full);
    if (size < good.size() - 10) expect("tiff.corrupt", full);
  }
}

TEST_F(CogPackage, ArtifactHashForAByteOfEveryPage) {
  const fs::path package = maker_.make(folder_);
  for (const std::string_view name : {kCogFile, kSidecarFile}) {
    const Bytes good = read_file(package / name);
    for (std::size_t page = 0; page * 4096 < good.size(); ++page) {
      Bytes bad = good;
      bad[std::min(page * 4096 + (page * 977) % 4096, bad.size() - 1)] ^= 0x10;
      overwrite(package / name, bad);
      const Verification result = maker_.verify(package, VerifyDepth::full);
      ASSERT_TRUE(result.findings.contains("artifact.hash"))
          << name << " page " << page << ": " << codes(result.findings);
    }
    overwrite(package / name, good);
  }
}

TEST_F(CogPackage, ATileWithoutSidecarAndASidecarWithoutTile) {
  const fs::path package = maker_.make(folder_);
  const auto tiles = maker_.verify(package).tiles;
  // The place of a tile in the table of the finest zoom becomes empty.
  Bytes file = read_file(package / kCogFile);
  const std::size_t place = place_of(package, tiles.back().key);
  const CogReader reader(package / kCogFile);
  const auto size = static_cast<std::uint32_t>(reader.stored_size(tiles.back().key));
  for (std::size_t at = 8; at + 4 < 2000; at += 2) {  // the table of sizes
    const std::uint32_t value = file[at] + 256U * file[at + 1] + 65536U * file[at + 2];
    if (value == size && file[at + 3] == 0)
      std::fill_n(file.begin() + static_cast<std::ptrdiff_t>(at), 4, std::uint8_t{0});
  }
  ASSERT_GT(place, 0U);
  overwrite(package / kCogFile, file);
  expect("tiles.count", maker_.verify(package));
}

TEST_F(CogPackage, ReadsATamperedTileAsMissing) {
  const fs::path package = maker_.make(folder_);
  const Opening good = open(package);
  ASSERT_TRUE(good.package) << codes(good.findings);
  const CheckedTiles& tiles = good.package->imagery();
  for (const Sidecar& sidecar : tiles.sidecars()) EXPECT_EQ(sha256(tiles.read(sidecar.key).value()), sidecar.sha256);
  EXPECT_FALSE(tiles.read({18, 0, 0}));
  const TileKey key = tiles.sidecars()[2].key, last = tiles.sidecars().back().key;
  flip(package / kCogFile, place_of(package, key) + 500);
  const Opening opening = open(package);  // quick: tiles are not hashed
  ASSERT_TRUE(opening.package) << codes(opening.findings);
  EXPECT_FALSE(opening.package->imagery().read(key));
  EXPECT_TRUE(opening.package->imagery().read(last));
  EXPECT_EQ(codes(opening.package->imagery().findings()), "artifact.hash");
  fs::resize_file(package / kCogFile, place_of(package, last) + 10);  // the medium fails in flight
  EXPECT_FALSE(opening.package->imagery().read(last));
  EXPECT_EQ(codes(opening.package->imagery().findings()), "artifact.hash, tiff.corrupt");
}

}  // namespace
}  // namespace nadir
