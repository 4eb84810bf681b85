// What somebody who can write to the medium of a package may try while it is verified: other sizes, code, pipes, and
// files that are exchanged between two looks.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>

#include "package/open_package.hpp"
#include "package/tile_container.hpp"
#include "package/verify_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using UntrustedFiles = test::Verify;

void append(const fs::path& file, std::string_view bytes) {
  std::ofstream(file, std::ios::binary | std::ios::app) << bytes;
}

// Does something once a stage of the verification begins.
class DoAt final : public Progress {
 public:
  DoAt(std::string stage, std::function<void()> work) : stage_(std::move(stage)), work_(std::move(work)) {}
  void begin(std::string_view label, std::uint64_t, std::string_view) override { label_ = label; }
  void advance(std::uint64_t) override {}
  void end() override {
    if (label_ == stage_ && work_) std::exchange(work_, nullptr)();
  }

 private:
  std::string stage_, label_;
  std::function<void()> work_;
};

// A view in a file of the wrong size was executed: two gigabytes of temporary files. Now nothing reads such a file.
TEST_F(UntrustedFiles, ImageryOfAnotherSizeIsNotOpened) {
  const fs::path package = maker_.make(folder_);
  test::sqlite(package / kImageryFile,
               "ALTER TABLE nadir_sidecars RENAME TO old; CREATE VIEW nadir_sidecars AS SELECT * FROM old;");
  append(package / kImageryFile, std::string(4096, '\0'));
  for (const VerifyDepth depth : {VerifyDepth::quick, VerifyDepth::full}) {
    const Verification verification = maker_.verify(package, depth);
    expect_only("artifact.size", verification);
    EXPECT_TRUE(verification.tiles.empty());
  }
}

TEST_F(UntrustedFiles, CodeInTheImageryIsRefusedAtQuickDepth) {
  const fs::path package = maker_.make(folder_);
  const auto signed_size = fs::file_size(package / kImageryFile);
  test::sqlite(package / kImageryFile,
               "PRAGMA writable_schema = ON; ALTER TABLE nadir_sidecars RENAME TO old;"
               "CREATE VIEW nadir_sidecars AS SELECT 18 AS zoom_level, 1 AS tile_column, 1 AS tile_row,"
               " zeroblob(30000000) AS sha256, '' AS source, '' AS captured_at, 1 AS gsd_mm, 1 AS ce90_mm, '' AS trust,"
               " '' AS sector, 1 AS valid_ppm, zeroblob(30000000) AS mask FROM old");
  if (fs::file_size(package / kImageryFile) != signed_size) {
    maker_.edit_manifest = [&](Manifest& manifest) {
      manifest.artifacts[0].size = fs::file_size(package / kImageryFile);
    };
    // The size is no secret: an attacker fits the file to it. Here the manifest is fitted to the file.
    const fs::path other = maker_.make(folder_, "other");
    fs::copy_file(package / kImageryFile, other / kImageryFile, fs::copy_options::overwrite_existing);
    const Verification verification = maker_.verify(other);
    expect_only("sqlite.corrupt", verification);
    EXPECT_EQ(verification.findings.items().front().found, "a view");
    return;
  }
  const Verification verification = maker_.verify(package);
  expect_only("sqlite.corrupt", verification);
  EXPECT_EQ(verification.findings.items().front().found, "a view");
}

// Each of these waited for a writer that never came, and SIGTERM was swallowed.
TEST_F(UntrustedFiles, APipeInPlaceOfAnyFileIsAFinding) {
  for (const std::string_view name : {kImageryFile, kMissionFile, kManifestFile, kSignatureFile}) {
    const fs::path package = maker_.make(folder_, "with-pipe-" + std::string(fs::path(name).filename()));
    fs::remove(package / name);
    ASSERT_EQ(::mkfifo((package / name).c_str(), 0600), 0);
    const Verification verification = maker_.verify(package, VerifyDepth::full);
    EXPECT_TRUE(verification.findings.has_errors()) << name;
  }
  const fs::path package = maker_.make(folder_, "root");
  fs::create_directories(package / "root");
  ASSERT_EQ(::mkfifo((package / "root/2.root.json").c_str(), 0600), 0);
  expect("artifact.unexpected", maker_.verify(package));
}

// mission.yaml was hashed, then opened again by its name.
TEST_F(UntrustedFiles, TheMissionThatWasHashedIsTheOneThatIsParsed) {
  const fs::path package = maker_.make(folder_);
  const std::string other = test::mission_yaml({{"agl_m: 120", "agl_m: 450"}});
  DoAt swap("hashing", [&] {
    folder_.write("other.yaml", other);
    fs::rename(folder_ / "other.yaml", package / kMissionFile);
  });
  const Verification verification = verify_package(package, maker_.options(), swap);
  EXPECT_TRUE(verification.accepted()) << test::codes(verification.findings);
  ASSERT_TRUE(verification.mission);
  EXPECT_EQ(verification.mission->route.agl_m, 120);
}

// `current` is a link, and the folder behind it may be exchanged while a flight reads it.
TEST_F(UntrustedFiles, APackageStaysTheOneThatWasVerified) {
  const fs::path good = maker_.make(folder_, "good");
  maker_.edit_tile = [](Sidecar&, Bytes& tile) {
    tile = test::noise_tile(99);
    return true;
  };
  maker_.make(folder_, "other");
  fs::create_directory_symlink(good, folder_ / "current");
  const auto point_to_other = [&] {
    fs::remove(folder_ / "current");
    fs::create_directory_symlink(folder_ / "other", folder_ / "current");
  };
  DoAt swap("hashing", point_to_other);
  const Opening opening = open_package(folder_ / "current", maker_.options(), swap);
  ASSERT_NE(opening.package, nullptr) << test::codes(opening.findings);
  const CheckedTiles& tiles = opening.package->imagery();
  const std::unique_ptr<CheckedTiles> again = opening.package->another_imagery_reader();
  for (const Sidecar& tile : tiles.sidecars()) {
    EXPECT_TRUE(tiles.read(tile.key)) << to_text(tile.key);
    EXPECT_TRUE(again->read(tile.key)) << to_text(tile.key);
  }
  EXPECT_TRUE(tiles.findings().empty());
  EXPECT_EQ(opening.package->folder().open(kMissionFile).sha256(), sha256_file(good / kMissionFile));
}

TEST_F(UntrustedFiles, AFileInPlaceOfAFolderOrTooLongAPathIsReported) {
  NoProgress progress;
  try {
    verify_package(folder_ / std::string(5000, 'p'), maker_.options(), progress);
    ADD_FAILURE() << "verified";
  } catch (const Error& error) {
    EXPECT_EQ(error.text().found, "File name too long");
  }
}

// A two-megabyte GeoTIFF in place of the signed one, of the signed size, listed 67 million tiles: 817 MB.
TEST_F(UntrustedFiles, ACogWithMoreTilesThanWereSignedIsRefused) {
  maker_.cog = true;
  const fs::path package = maker_.make(folder_);
  const TileSetFacts facts = [&] {
    TileSetFacts one = tile_set_facts(package / kCogFile);
    one.count -= 1;
    return one;
  }();
  NoProgress progress;
  const TileSetCheck check =
      check_tile_set(open_tile_set_files(package / kCogFile), facts, VerifyDepth::quick, progress);
  EXPECT_TRUE(check.findings.contains("tiff.layout")) << test::codes(check.findings);
}

TEST_F(UntrustedFiles, TilesStateTheirOwnPlacementError) {
  maker_.edit_tile = [](Sidecar& sidecar, Bytes&) {
    if (sidecar.key.z == 17) sidecar.ce90_mm = 12'500;
    return true;
  };
  const Opening opening = [&] {
    NoProgress progress;
    return open_package(maker_.make(folder_), maker_.options(), progress);
  }();
  ASSERT_NE(opening.package, nullptr) << test::codes(opening.findings);
  for (const Sidecar& tile : opening.package->imagery().sidecars()) {
    EXPECT_EQ(opening.package->imagery().ce90_m(tile.key), tile.key.z == 17 ? 12.5 : 4.0);
  }
  EXPECT_FALSE(opening.package->imagery().ce90_m({3, 1, 1}));
}

}  // namespace
}  // namespace nadir
