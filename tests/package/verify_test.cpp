#include <gtest/gtest.h>
#include <algorithm>

#include "base/error.hpp"
#include "imagery/cog_reader.hpp"
#include "package/open_package.hpp"
#include "package/verify_fixture.hpp"

namespace nadir {
namespace {

using test::codes;
using test::mission_yaml;
using test::PackageMaker;
using test::Verify;

// Signature, manifest and policy: one test per finding, so that the fault that it names is caught and nothing else
// hides it.

namespace fs = std::filesystem;

TEST_F(Verify, AcceptsAnIntactPackage) {
  const fs::path package = maker_.make(folder_);
  for (const VerifyDepth depth : {VerifyDepth::quick, VerifyDepth::full}) {
    const Verification result = maker_.verify(package, depth);
    EXPECT_TRUE(result.accepted()) << codes(result.findings);
    EXPECT_TRUE(result.findings.empty()) << codes(result.findings);
    EXPECT_EQ(result.signers, std::vector{maker_.signer.public_key().id()});
    EXPECT_EQ(result.mission->id, "village-a");
    EXPECT_GT(result.tiles.size(), 4U);
  }
}

TEST_F(Verify, SignatureInvalidForEveryFlippedByteOfTheManifest) {
  const fs::path package = maker_.make(folder_);
  const Bytes good = read_file(package / kManifestFile);
  for (std::size_t at = 0; at < good.size(); ++at) {
    Bytes bad = good;
    bad[at] ^= static_cast<std::uint8_t>(1U << (at % 8));
    overwrite(package / kManifestFile, bad);
    const Verification result = maker_.verify(package);
    ASSERT_EQ(codes(result.findings), "signature.invalid") << "byte " << at;
    ASSERT_FALSE(result.manifest) << "parsed although the signature had failed";
  }
}

TEST_F(Verify, RejectsEveryFlippedBitOfTheSignatureFile) {
  const fs::path package = maker_.make(folder_);
  const Bytes good = read_file(package / kSignatureFile);
  for (std::size_t at = 0; at < good.size(); ++at) {
    for (unsigned bit = 0; bit < 8; ++bit) {
      Bytes bad = good;
      bad[at] ^= static_cast<std::uint8_t>(1U << bit);
      overwrite(package / kSignatureFile, bad);
      const Verification result = maker_.verify(package);
      ASSERT_FALSE(result.accepted()) << "byte " << at << " bit " << bit;
      ASSERT_FALSE(result.manifest);
    }
  }
}

TEST_F(Verify, SignatureMissing) {
  const fs::path package = maker_.make(folder_);
  fs::remove(package / kSignatureFile);
  expect_only("signature.missing", maker_.verify(package));
}

TEST_F(Verify, SignatureMissingWhenTheThresholdIsNotMet) {
  const PrivateKey second = PrivateKey::generate();
  maker_.root.add_key(second.public_key());
  maker_.root.package_signer.key_ids.insert(second.public_key().id());
  maker_.root.package_signer.threshold = 2;
  expect_only("signature.missing", maker_.verify(maker_.make(folder_)));
}

TEST_F(Verify, KeyUnknown) {
  const PackageMaker untrusted;
  expect_only("key.unknown", maker_.verify(untrusted.make(folder_)));
}

TEST_F(Verify, KeyRevoked) {
  maker_.root.revoked.insert(maker_.signer.public_key().id());
  expect_only("key.revoked", maker_.verify(maker_.make(folder_)));
}

TEST_F(Verify, KeyExpired) {
  const fs::path package = maker_.make(folder_);
  maker_.root.keys.at(maker_.signer.public_key().id()).expires = test::kJudged;
  expect_only("key.expired", maker_.verify(package));
}

TEST_F(Verify, KeyExpiredWithItsRoot) {
  const fs::path package = maker_.make(folder_);
  maker_.root.expires = test::kJudged;
  expect_only("key.expired", maker_.verify(package));
}

TEST_F(Verify, ManifestSchema) {
  maker_.edit_bytes = [](std::string& bytes) { bytes = R"({"schema":"nadir.manifest/2"})"; };
  expect_only("manifest.schema", maker_.verify(maker_.make(folder_)));
}

TEST_F(Verify, ManifestSchemaForAnOversizedManifest) {
  const fs::path package = maker_.make(folder_);
  fs::resize_file(package / kManifestFile, (1 << 20) + 1);
  expect_only("manifest.schema", maker_.verify(package));
  fs::resize_file(package / kManifestFile, std::uintmax_t{1} << 40);  // sparse; must not be read
  expect_only("manifest.schema", maker_.verify(package));
}

TEST_F(Verify, ManifestPath) {
  maker_.edit_manifest = [](Manifest& manifest) { manifest.artifacts[1].path = "../mission.yaml"; };
  expect_only("manifest.path", maker_.verify(maker_.make(folder_)));
}

TEST_F(Verify, PackageRollback) {
  const fs::path package = maker_.make(folder_);
  AircraftState state;
  VerifyOptions options = maker_.options();
  options.state = &state;
  state.accept("village", 3, 1, {0});
  EXPECT_TRUE(with_options(package, options).accepted());
  state.accept("another", 9, 1, {0});
  EXPECT_TRUE(with_options(package, options).accepted());
  state.accept("village", 4, 1, {0});
  expect_only("package.rollback", with_options(package, options));
}

TEST_F(Verify, RootRollback) {
  const fs::path package = maker_.make(folder_);
  AircraftState state;
  state.root_version = 2;
  VerifyOptions options = maker_.options();
  options.state = &state;
  expect_only("root.rollback", with_options(package, options));
}

TEST_F(Verify, PackageExpired) {
  const fs::path package = maker_.make(folder_);
  VerifyOptions options = maker_.options();
  options.at = parse_utc("2024-05-31T23:59:59Z").value();
  EXPECT_TRUE(with_options(package, options).accepted());
  options.at = parse_utc("2024-06-01").value();
  expect_only("package.expired", with_options(package, options));
}

TEST_F(Verify, TimeUntrusted) {
  const fs::path package = maker_.make(folder_);
  VerifyOptions options = maker_.options();
  options.at = parse_utc("1970-01-02").value();  // a clock without battery
  expect_only("time.untrusted", with_options(package, options));
  AircraftState state;
  state.accept("x", 1, 1, parse_utc("2024-04-26").value());
  options = maker_.options();
  options.state = &state;
  expect_only("time.untrusted", with_options(package, options));
}

TEST_F(Verify, AirframeMismatch) {
  const fs::path package = maker_.make(folder_);
  VerifyOptions options = maker_.options();
  options.airframe = "mini-08";
  EXPECT_TRUE(with_options(package, options).accepted());
  options.airframe = "mini-0";
  expect_only("airframe.mismatch", with_options(package, options));
}

TEST_F(Verify, AnyAirframeMayFlyAPackageForAll) {
  maker_.mission = mission_yaml({{"[mini-07, mini-08]", "[any]"}});
  VerifyOptions options = maker_.options();
  options.airframe = "whoever";
  EXPECT_TRUE(with_options(maker_.make(folder_), options).accepted());
}

// Files, tiles and the mission's demands: one test per finding.

namespace fs = std::filesystem;

TEST_F(Verify, ArtifactMissing) {
  const fs::path package = maker_.make(folder_);
  fs::remove(package / kMissionFile);
  expect_only("artifact.missing", maker_.verify(package));
}

TEST_F(Verify, ArtifactUnexpected) {
  const fs::path package = maker_.make(folder_);
  std::ofstream(package / "imagery/extra") << "x";
  expect_only("artifact.unexpected", maker_.verify(package));
}

// A write-ahead log beside the database would change what SQLite reads.
TEST_F(Verify, ArtifactUnexpectedForAJournal) {
  const fs::path package = maker_.make(folder_);
  std::ofstream(package / "imagery/base.mbtiles-wal") << "x";
  expect_only("artifact.unexpected", maker_.verify(package));
}

TEST_F(Verify, ArtifactUnexpectedForLinksAndDevices) {
  const fs::path package = maker_.make(folder_);
  fs::rename(package / kMissionFile, folder_ / "mission.yaml");
  fs::create_symlink(folder_ / "mission.yaml", package / kMissionFile);
  Verification result = maker_.verify(package);
  expect("artifact.unexpected", result);
  expect("artifact.missing", result);
  fs::remove(package / kMissionFile);
  ASSERT_EQ(::system(("mkfifo '" + (package / kMissionFile).string() + "'").c_str()), 0);
  expect("artifact.unexpected", maker_.verify(package, VerifyDepth::full));  // and does not wait for a writer
}

TEST_F(Verify, ALinkedFolderIsUnexpected) {
  const fs::path package = maker_.make(folder_);
  fs::rename(package / "mission", folder_ / "elsewhere");
  fs::create_directory_symlink(folder_ / "elsewhere", package / "mission");
  expect("artifact.unexpected", maker_.verify(package));
}

TEST_F(Verify, LinkedManifestOrSignatureIsRejected) {
  for (const std::string_view name : {kManifestFile, kSignatureFile}) {
    const fs::path package = maker_.make(folder_, std::string(name));
    fs::rename(package / name, folder_ / "moved");
    fs::create_symlink(folder_ / "moved", package / name);
    EXPECT_FALSE(maker_.verify(package).accepted()) << name;
  }
}

TEST_F(Verify, ArtifactSize) {
  const fs::path package = maker_.make(folder_);
  std::ofstream(package / kImageryFile, std::ios::app) << "x";
  expect("artifact.size", maker_.verify(package));
  const fs::path second = maker_.make(folder_, "second");
  std::ofstream(second / kMissionFile, std::ios::app) << "#";
  expect_only("artifact.size", maker_.verify(second));
}

TEST_F(Verify, ArtifactHash) {
  const fs::path package = maker_.make(folder_);
  flip(package / kMissionFile, 30);
  expect_only("artifact.hash", maker_.verify(package));
}

TEST_F(Verify, ArtifactHashForAByteOfEveryPage) {
  const fs::path package = maker_.make(folder_);
  const Bytes good = read_file(package / kImageryFile);
  for (std::size_t page = 0; page * 4096 < good.size(); ++page) {
    Bytes bad = good;
    bad[page * 4096 + (page * 977) % 4096] ^= 0x10;
    overwrite(package / kImageryFile, bad);
    const Verification result = maker_.verify(package, VerifyDepth::full);
    ASSERT_TRUE(result.findings.contains("artifact.hash")) << "page " << page << ": " << codes(result.findings);
  }
}

TEST_F(Verify, FullNamesTheTamperedTile) {
  const fs::path package = maker_.make(folder_);
  test::sqlite(package / kImageryFile, "UPDATE tiles SET tile_data = zeroblob(length(tile_data)) WHERE rowid = 5");
  const Verification result = maker_.verify(package, VerifyDepth::full);
  expect("artifact.hash", result);
  expect("tile.undecodable", result);
  const std::string wanted = "tile " + to_text(result.tiles[4].key);
  EXPECT_TRUE(std::any_of(result.findings.items().begin(), result.findings.items().end(), [&](const Finding& finding) {
    return finding.code == "artifact.hash" && finding.where.find(wanted) != std::string::npos;
  })) << wanted;
}

TEST_F(Verify, TilesRootForSwappedTilesWithRecomputedDigests) {
  const fs::path package = maker_.make(folder_);
  // Two tiles of a zoom change places; so do their digests, as an attacker would do it.
  test::sqlite(package / kImageryFile,
               "CREATE TEMP TABLE t AS SELECT rowid AS i, * FROM tiles WHERE zoom_level = 18 ORDER BY rowid LIMIT 2;"
               "CREATE TEMP TABLE s AS SELECT sha256, zoom_level, tile_column, tile_row FROM nadir_sidecars;"
               "UPDATE tiles SET tile_data = (SELECT tile_data FROM t WHERE i <> tiles.rowid)"
               " WHERE rowid IN (SELECT i FROM t);"
               "UPDATE nadir_sidecars AS n SET sha256 = (SELECT s.sha256 FROM s, t a, t b WHERE a.i <> b.i"
               " AND a.tile_column = n.tile_column AND a.tile_row = n.tile_row AND s.zoom_level = 18"
               " AND s.tile_column = b.tile_column AND s.tile_row = b.tile_row)"
               " WHERE zoom_level = 18 AND EXISTS (SELECT 1 FROM t WHERE t.tile_column = n.tile_column"
               " AND t.tile_row = n.tile_row);");
  sign_sizes(package);
  expect("tiles.root", maker_.verify(package));
}

// Dates decide about freshness: they are signed like the images.
TEST_F(Verify, TilesRootForForgedDates) {
  maker_.edit_tile = [](Sidecar& sidecar, Bytes&) {
    sidecar.captured_at = parse_utc("2020-01-01").value();
    return true;
  };
  const fs::path package = maker_.make(folder_);
  expect("freshness.stale", maker_.verify(package));
  test::sqlite(package / kImageryFile, "UPDATE nadir_sidecars SET captured_at = '2024-04-01T00:00:00Z'");
  expect("tiles.root", maker_.verify(package));
}

TEST_F(Verify, TilesRootForForgedMasks) {
  const fs::path package = maker_.make(folder_);
  test::sqlite(package / kImageryFile, "UPDATE nadir_sidecars SET mask = x'00' WHERE zoom_level = 17");
  expect("tiles.root", maker_.verify(package));
}

TEST_F(Verify, TilesCount) {
  const fs::path package = maker_.make(folder_);
  test::sqlite(package / kImageryFile, "DELETE FROM tiles WHERE rowid = 3");
  expect("tiles.count", maker_.verify(package));
  const fs::path second = maker_.make(folder_, "second");
  test::sqlite(second / kImageryFile, "DELETE FROM nadir_sidecars WHERE zoom_level = 17");
  expect("tiles.count", maker_.verify(second));
}

TEST_F(Verify, TilesCountForATileWithoutSidecar) {
  const fs::path package = maker_.make(folder_);
  test::sqlite(package / kImageryFile, "INSERT INTO tiles VALUES (10, 1, 1, x'00')");
  sign_sizes(package);
  expect("tiles.count", maker_.verify(package));
}

// What a signer checks of tiles; who verifies a package trusts the signer with it.
TEST_F(Verify, TileUndecodable) {
  maker_.edit_tile = [](Sidecar&, Bytes& tile) {
    tile.assign(100, 7);
    return true;
  };
  maker_.edit_manifest = [](Manifest& manifest) { manifest.artifacts[0].tiles->format = "jpeg"; };
  EXPECT_TRUE(before_signing(maker_.make(folder_)).contains("tile.undecodable"));
}

TEST_F(Verify, TileSize) {
  maker_.edit_tile = [](Sidecar& sidecar, Bytes& tile) {
    if (sidecar.key.z == 17) tile = test::noise_tile(1, 128);
    return true;
  };
  const Findings findings = before_signing(maker_.make(folder_));
  EXPECT_TRUE(findings.contains("tile.size"));
  for (const Finding& finding : findings.items()) EXPECT_EQ(finding.code, "tile.size") << finding.where;
}

TEST_F(Verify, TileMisaddressed) {
  const fs::path package = maker_.make(folder_);
  test::sqlite(package / kImageryFile, "INSERT INTO tiles VALUES (2, 4, 0, x'00')");
  sign_sizes(package);
  expect("tile.misaddressed", maker_.verify(package));
  const fs::path second = maker_.make(folder_, "second");
  test::sqlite(second / kImageryFile,
               "UPDATE nadir_sidecars SET tile_row = -1 WHERE (tile_column, tile_row) ="
               " (SELECT tile_column, tile_row FROM nadir_sidecars LIMIT 1)");
  expect("tile.misaddressed", maker_.verify(second));
}

TEST_F(Verify, CoverageGapForAMissingTile) {
  maker_.edit_tile = [n = 0](Sidecar& sidecar, Bytes&) mutable { return sidecar.key.z != 18 || ++n != 6; };
  expect_only("coverage.gap", maker_.verify(maker_.make(folder_)));
}

TEST_F(Verify, FreshnessStale) {
  maker_.edit_tile = [](Sidecar& sidecar, Bytes&) {
    sidecar.captured_at = parse_utc("2022-01-01").value();
    return true;
  };
  expect_only("freshness.stale", maker_.verify(maker_.make(folder_)));
}

TEST_F(Verify, ResolutionCoarse) {
  maker_.edit_tile = [](Sidecar& sidecar, Bytes&) {
    sidecar.gsd_mm = 501;
    return true;
  };
  expect_only("resolution.coarse", maker_.verify(maker_.make(folder_)));
}

TEST_F(Verify, BudgetExceeded) {
  maker_.mission = mission_yaml({{"budget_mb: 20", "budget_mb: 1"}});
  maker_.edit_tile = [](Sidecar&, Bytes& tile) {
    tile.resize(tile.size() + 100'000, 0);  // JPEG ends before; size is size
    return true;
  };
  expect_only("budget.exceeded", maker_.verify(maker_.make(folder_)));
}

TEST_F(Verify, MissionMismatch) {
  maker_.edit_manifest = [](Manifest& manifest) { manifest.mission_id = "another"; };
  expect_only("mission.mismatch", maker_.verify(maker_.make(folder_)));
}

TEST_F(Verify, MissionMismatchWithoutMission) {
  maker_.edit_manifest = [](Manifest& manifest) { manifest.artifacts[1].role = "notes"; };
  expect_only("mission.mismatch", maker_.verify(maker_.make(folder_)));
}

TEST_F(Verify, SqliteCorrupt) {
  const fs::path package = maker_.make(folder_);
  const auto size = fs::file_size(package / kImageryFile);
  fs::resize_file(package / kImageryFile, 0);
  fs::resize_file(package / kImageryFile, size);
  expect_only("sqlite.corrupt", maker_.verify(package));
}

// Full verification hashes a file once: by blocks, and none of its tiles. Nothing of the container may slip through.
TEST_F(Verify, ArtifactHashForAContainerThatLeadsToTheSameTiles) {
  for (const bool cog : {false, true}) {
    maker_.cog = cog;
    const fs::path package = maker_.make(folder_, cog ? "cog" : "mbtiles");
    const fs::path file = package / maker_.imagery_file();
    const Bytes good = read_file(file);
    std::map<std::string, std::function<void(Bytes&)>> attacks = {
        {"two blocks change places",
         [](Bytes& bytes) { std::swap_ranges(bytes.begin() + 4096, bytes.begin() + 8192, bytes.end() - 8192); }},
        {"the end replaced by what was there before", [](Bytes& bytes) {
           std::copy(bytes.end() - 64, bytes.end() - 32, bytes.end() - 32);
           bytes.back() ^= 0x40;
         }}};
    if (cog) {
      // Two offsets beside each other, in the table of the finest zoom.
      const CogReader reader(file);
      const CogBlocks& blocks = reader.levels().front().picture;
      std::size_t tile = 0;
      while (blocks.sizes[tile] == 0 || blocks.sizes[tile + 1] == 0) ++tile;
      Bytes wanted;
      for (const std::uint64_t place : {blocks.places[tile], blocks.places[tile + 1]}) {
        for (int i = 0; i < 4; ++i) wanted.push_back(static_cast<std::uint8_t>(place >> (8 * i)));
      }
      const auto table = [wanted](Bytes& bytes) {
        const auto at = std::search(bytes.begin(), bytes.end(), wanted.begin(), wanted.end());
        EXPECT_NE(at, bytes.end());
        return at;
      };
      attacks["two offsets change places"] = [table](Bytes& bytes) {
        const auto at = table(bytes);
        std::swap_ranges(at, at + 4, at + 4);
      };
      attacks["two tiles overlap"] = [table](Bytes& bytes) { std::copy_n(table(bytes), 4, table(bytes) + 4); };
    } else {
      attacks["metadata that no tile depends on"] = [](Bytes& bytes) {
        const std::string_view name = "agg_tiles_hash";
        const auto at = std::search(bytes.begin(), bytes.end(), name.begin(), name.end());
        ASSERT_NE(at, bytes.end());
        at[20] ^= 1;
      };
      attacks["reserved bytes of the header"] = [](Bytes& bytes) { bytes[80] = 1; };
      attacks["the program that wrote the file"] = [](Bytes& bytes) { bytes[99] ^= 1; };
    }
    for (const auto& [what, attack] : attacks) {
      Bytes bad = good;
      attack(bad);
      ASSERT_NE(bad, good) << what;
      overwrite(file, bad);
      for (const int threads : {1, 3}) {
        VerifyOptions options = maker_.options(VerifyDepth::full);
        options.threads = threads;
        expect("artifact.hash", with_options(package, options));
      }
    }
    Bytes longer = good;  // behind the end, or beyond it
    longer.push_back(0);
    overwrite(file, longer);
    expect_only("artifact.size", maker_.verify(package, VerifyDepth::full));
  }
}

// A signer who compared one of a file's two digests would vouch for another file to those who compare the other.
TEST_F(Verify, ASignerComparesAllDigestsAndTiles) {
  for (const bool cog : {false, true}) {
    maker_.cog = cog;
    const fs::path package = maker_.make(folder_, cog ? "cog" : "mbtiles");
    EXPECT_TRUE(before_signing(package).empty()) << codes(before_signing(package));
    sign_imagery(package, [](Artifact& artifact) { artifact.sha256.bytes[0] ^= 1; });
    EXPECT_TRUE(before_signing(package).contains("artifact.hash"));
    sign_imagery(package, [](Artifact& artifact) {
      artifact.sha256.bytes[0] ^= 1;
      artifact.fsverity->bytes[0] ^= 1;
    });
    EXPECT_TRUE(before_signing(package).contains("artifact.hash"));
    expect("artifact.hash", maker_.verify(package, VerifyDepth::full));
    EXPECT_TRUE(maker_.verify(package).accepted());
  }
  // A tile that is not the one of its sidecar, in a file that is described as it is.
  maker_.cog = false;
  const fs::path package = maker_.make(folder_, "tile");
  test::sqlite(package / kImageryFile, "UPDATE tiles SET tile_data = zeroblob(length(tile_data)) WHERE rowid = 5");
  sign_imagery(package, [&](Artifact& artifact) {
    const std::optional<TileSetFacts> tiles = artifact.tiles;
    artifact = describe_file(package, kImageryFile, kRoleImagery);
    artifact.tiles = tiles;
  });
  const Findings findings = before_signing(package);
  EXPECT_TRUE(findings.contains("artifact.hash"));
  // Signed nevertheless: no such tile is used.
  NoProgress progress;
  const Opening opening = open_package(package, maker_.options(VerifyDepth::full), progress);
  ASSERT_TRUE(opening.package) << codes(opening.findings);
  std::size_t missing = 0;
  for (const Sidecar& tile : opening.package->imagery().sidecars()) {
    if (!opening.package->imagery().read(tile.key)) ++missing;
  }
  EXPECT_EQ(missing, 1U);
}

TEST_F(Verify, APackageWithoutFsverityIsHashedAsBefore) {
  maker_.edit_manifest = [](Manifest& manifest) { manifest.artifacts[0].fsverity.reset(); };
  const fs::path package = maker_.make(folder_);
  EXPECT_TRUE(maker_.verify(package, VerifyDepth::full).accepted());
  EXPECT_TRUE(before_signing(package).empty());
  flip(package / kImageryFile, 80);
  expect("artifact.hash", maker_.verify(package, VerifyDepth::full));
  EXPECT_TRUE(before_signing(package).contains("artifact.hash"));
}

TEST_F(Verify, MixAndMatchOfTwoValidPackages) {
  const auto of_one_length = [](std::uint32_t factor) {  // and so of one size, the files that hold them
    return [factor](Sidecar& sidecar, Bytes& tile) {
      tile = test::noise_tile(sidecar.key.x * factor + sidecar.key.y);
      tile.resize(100'000, 0);
      return true;
    };
  };
  maker_.edit_tile = of_one_length(55);
  const fs::path first = maker_.make(folder_, "first");
  maker_.edit_tile = of_one_length(77);
  const fs::path second = maker_.make(folder_, "second");
  fs::copy_file(second / kImageryFile, first / kImageryFile, fs::copy_options::overwrite_existing);
  expect("tiles.root", maker_.verify(first));
  fs::copy_file(second / kSignatureFile, first / kSignatureFile, fs::copy_options::overwrite_existing);
  expect_only("signature.invalid", maker_.verify(first));
}

TEST_F(Verify, QuotesNoEscapeSequences) {
  const fs::path package = maker_.make(folder_);
  std::ofstream(package / "imagery/\x1b[2Jgone") << "x";
  const Verification result = maker_.verify(package);
  expect_only("artifact.unexpected", result);
  EXPECT_EQ(to_text(result.findings.items()[0]).find('\x1b'), std::string::npos);
}

TEST_F(Verify, ThrowsForAFolderThatIsNotAPackage) {
  EXPECT_THROW(maker_.verify(folder_ / "nothing"), Error);
  EXPECT_THROW(maker_.verify(folder_.path()), Error);
  EXPECT_THROW(maker_.verify(folder_.write("file", "x")), Error);
}

// The same attacks on a package whose tiles lie in a COG, and flying with one.

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

// Each file is valid by itself, but they do not belong together.
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
    expect_only("artifact.size", full);  // and nothing reads it
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
