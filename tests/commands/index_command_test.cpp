// nadir cache index as a user calls it, and what verification says about indexes that are not what they should be.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/files.hpp"
#include "base/random.hpp"
#include "cli/program.hpp"
#include "imagery/codecs.hpp"
#include "package/package_maker.hpp"
#include "package/package_roots.hpp"
#include "package/package_writer.hpp"
#include "commands/commands.hpp"
#include "vision/place_index.hpp"
#include "vision/place_index_files.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class CacheIndex : public ::testing::Test {
 protected:
  CacheIndex() { write_file_atomic(key(), maker_.signer.pem(), 0600); }
  int index(std::vector<std::string> args) {
    out_.str("");
    err_.str("");
    args.insert(args.begin(), {"cache", "index"});
    args.insert(args.end(), {"--overlap-percent", "40"});  // few squares, so that the tests are quick
    return run_program(nadir_text(), all_commands(), args, {out_, err_, clock_});
  }
  fs::path indexed(const std::string& name = "package") {
    const fs::path package = maker_.make(folder_, name);
    EXPECT_EQ(index({package.string(), "--key", key().string()}), 0) << err_.str();
    return package;
  }
  fs::path key() const { return folder_ / "p.key.pem"; }
  static std::map<std::string, Sha256> contents(const fs::path& folder) {
    std::map<std::string, Sha256> all;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      if (entry.is_regular_file()) all[entry.path().lexically_relative(folder)] = sha256_file(entry.path());
    }
    return all;
  }
  Findings verify(const fs::path& package, VerifyDepth depth) {
    NoProgress progress;
    Verification verification = maker_.verify(package, depth);
    verify_place_index(package, depth, progress, verification);
    return verification.findings;
  }
  // As the signer would, had he been deceived: manifest and signature fit the files as they are.
  void sign_as_it_is(const fs::path& package, bool with_vectors = true) {
    Manifest manifest = *parse_manifest(read_file(package / kManifestFile)).manifest;
    std::erase_if(manifest.artifacts, [](const Artifact& artifact) { return artifact.path.starts_with("index/"); });
    manifest.artifacts.push_back(describe_file(package, kPlaceTableFile, kRolePlaceTable));
    if (with_vectors) manifest.artifacts.push_back(describe_file(package, kPlaceIndexFile, kRolePlaceIndex));
    write_manifest(package, manifest);
    maker_.sign(package);
  }
  static void overwrite(const fs::path& file, std::string_view bytes) { write_file_atomic(file, bytes); }

  test::TemporaryFolder folder_;
  FixedClock clock_{test::kJudged};
  std::ostringstream out_, err_;
  test::PackageMaker maker_;
};

TEST_F(CacheIndex, TheIndexedPackageIsAcceptedAndReproducible) {
  const fs::path package = indexed();
  EXPECT_NE(out_.str().find("places of 120 m"), std::string::npos) << out_.str();
  EXPECT_TRUE(verify(package, VerifyDepth::quick).empty()) << test::codes(verify(package, VerifyDepth::quick));
  EXPECT_TRUE(verify(package, VerifyDepth::full).empty()) << test::codes(verify(package, VerifyDepth::full));
  const auto first = contents(package);
  ASSERT_EQ(index({package.string(), "--key", key().string()}), 0) << "again: the old index is replaced";
  EXPECT_EQ(contents(package), first);
  for (const auto& entry : fs::directory_iterator(folder_.path())) {
    EXPECT_FALSE(entry.path().filename().string().starts_with(".package")) << entry.path();
  }
  NoProgress progress;
  Opening opening = open_package(package, maker_.options(), progress);
  verify_place_index(package, VerifyDepth::quick, progress, opening);
  EXPECT_NE(opening.package, nullptr);
}

TEST_F(CacheIndex, ASignedPackageIsNotChangedWithoutItsKey) {
  const fs::path package = maker_.make(folder_);
  const auto before = contents(package);
  EXPECT_EQ(index({package.string()}), 2);
  EXPECT_NE(err_.str().find("--key"), std::string::npos) << err_.str();
  EXPECT_EQ(contents(package), before);
}

TEST_F(CacheIndex, AnUnsignedPackageStaysUnsigned) {
  const fs::path package = maker_.make(folder_);
  fs::remove(package / kSignatureFile);
  ASSERT_EQ(index({package.string(), "--footprint-m", "100", "--footprint-m", "150", "--json"}), 0) << err_.str();
  const json document = json::parse(out_.str());
  EXPECT_EQ(document["layers"].size(), 2U);
  EXPECT_EQ(document["signed"], false);
  EXPECT_FALSE(fs::exists(package / kSignatureFile));
  maker_.sign(package);
  EXPECT_TRUE(verify(package, VerifyDepth::full).empty());
}

TEST_F(CacheIndex, KeepsOtherFilesAndRemovesLeftovers) {
  const fs::path package = maker_.make(folder_);
  fs::create_directories(package / kRootFolder);
  folder_.write("package/root/1.root.json", "{}");
  fs::create_directories(folder_ / ".package.amended");  // of a process that was killed
  folder_.write(".package.amended/rest", "x");
  ASSERT_EQ(index({package.string(), "--key", key().string()}), 0) << err_.str();
  EXPECT_EQ(read_text_file(package / "root/1.root.json"), "{}");
  EXPECT_FALSE(fs::exists(folder_ / ".package.amended"));
}

TEST_F(CacheIndex, RejectsDamagedPackagesAndExceededBudgets) {
  const fs::path damaged = maker_.make(folder_, "damaged");
  overwrite(damaged / kMissionFile, maker_.mission + "\n");
  EXPECT_EQ(index({damaged.string(), "--key", key().string()}), 1);
  EXPECT_NE(out_.str().find("artifact.size"), std::string::npos) << out_.str();

  maker_.mission = test::mission_yaml({{"budget_mb: 20", "budget_mb: 1"}});
  const fs::path tight = maker_.make(folder_, "tight");
  const auto before = contents(tight);
  EXPECT_EQ(index({tight.string(), "--key", key().string(), "--footprint-m", "16", "--footprint-m", "18"}), 1);
  EXPECT_NE(out_.str().find("budget.exceeded"), std::string::npos) << out_.str();
  EXPECT_EQ(contents(tight), before);
}

TEST_F(CacheIndex, NamesMissingOptions) {
  EXPECT_EQ(index({(folder_ / "none").string()}), 2);
  const fs::path package = maker_.make(folder_);
  EXPECT_EQ(index({package.string(), "--evaluate", "simulated"}), 2);
  EXPECT_NE(err_.str().find("nadir cache index"), std::string::npos) << err_.str();
  EXPECT_EQ(index({package.string(), "--key", key().string(), "--footprint-m", "10"}), 2) << "too few pixels";
  EXPECT_EQ(index({package.string(), "--key", key().string(), "--footprint-m", "nan"}), 2);
  EXPECT_EQ(index({package.string(), "--key", (folder_ / "none").string()}), 2);
  EXPECT_EQ(index({package.string(), "--key", key().string(), "--camera", (folder_ / "none").string()}), 2);
  EXPECT_TRUE(verify(package, VerifyDepth::full).empty());
}

TEST_F(CacheIndex, ReportsItsRecall) {
  const fs::path package = indexed();
  const auto before = contents(package);
  ASSERT_EQ(index({package.string(), "--evaluate", "simulated", "--views", "12", "--json"}), 0) << err_.str();
  const json document = json::parse(out_.str());
  EXPECT_EQ(document["heading_known"]["queries"], 12);
  EXPECT_GE(document["heading_known"]["recall_at_5"].get<double>(), 0.75);
  EXPECT_LE(document["heading_known"]["recall_at_1"], document["heading_known"]["recall_at_20"]);
  EXPECT_EQ(contents(package), before);
  ASSERT_EQ(index({package.string(), "--evaluate", "simulated", "--views", "2"}), 0);
  EXPECT_NE(out_.str().find("heading unknown"), std::string::npos);
  EXPECT_EQ(index({package.string(), "--evaluate", (folder_ / "none").string()}), 2);
}

TEST_F(CacheIndex, DetectsAnIndexOfOtherImagery) {
  const fs::path package = indexed();
  maker_.edit_tile = [](Sidecar& sidecar, Bytes& tile) {
    tile = test::noise_tile(7 + sidecar.key.x * 31 + sidecar.key.y);
    return true;
  };
  const fs::path other = indexed("other");
  for (const auto name : {kPlaceIndexFile, kPlaceTableFile}) {
    fs::copy_file(other / name, package / name, fs::copy_options::overwrite_existing);
  }
  sign_as_it_is(package);
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "index.mismatch");

  // With the root of this imagery written into its table, only a new look at the tiles shows it.
  const Manifest manifest = *parse_manifest(read_file(package / kManifestFile)).manifest;
  json table = json::parse(read_text_file(package / kPlaceTableFile));
  table["imagery_merkle_root"] = manifest.artifact(kRoleImagery)->tiles->merkle_root.hex();
  overwrite(package / kPlaceTableFile, table.dump());
  sign_as_it_is(package);
  EXPECT_TRUE(verify(package, VerifyDepth::quick).empty());
  EXPECT_TRUE(verify(package, VerifyDepth::full).contains("index.mismatch"));
}

TEST_F(CacheIndex, DetectsIncompleteTruncatedOrForeignIndexes) {
  const fs::path package = indexed();
  const std::string table = read_text_file(package / kPlaceTableFile);
  const Bytes vectors = read_file(package / kPlaceIndexFile);

  sign_as_it_is(package, false);
  EXPECT_TRUE(verify(package, VerifyDepth::quick).contains("artifact.unexpected"));
  fs::rename(package / kPlaceIndexFile, folder_ / "vectors");
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "index.mismatch") << "only the table";
  fs::rename(folder_ / "vectors", package / kPlaceIndexFile);

  for (const std::size_t size : {std::size_t{0}, std::size_t{20}, std::size_t{45}, vectors.size() - 4}) {
    write_file_atomic(package / kPlaceIndexFile, ByteView(vectors).first(size));
    sign_as_it_is(package);
    EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "index.mismatch") << size;
  }
  Bytes hostile = vectors;
  hostile[15] = 0x7f;  // as many vectors as no machine has
  write_file_atomic(package / kPlaceIndexFile, hostile);
  sign_as_it_is(package);
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "index.mismatch");

  write_file_atomic(package / kPlaceIndexFile, vectors);
  json moved = json::parse(table);
  moved["origin_e7"][0] = moved["origin_e7"][0].get<std::int64_t>() + 1000;
  overwrite(package / kPlaceTableFile, moved.dump());
  sign_as_it_is(package);
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "index.mismatch");

  overwrite(package / kPlaceTableFile, table);
  EXPECT_TRUE(verify(package, VerifyDepth::quick).has_errors()) << "signed otherwise";
  sign_as_it_is(package);
  EXPECT_TRUE(verify(package, VerifyDepth::full).empty());
}

TEST_F(CacheIndex, DetectsEveryFlippedByte) {
  const fs::path package = indexed();
  for (const auto name : {kPlaceIndexFile, kPlaceTableFile}) {
    const Bytes sound = read_file(package / name);
    for (std::size_t at = 0; at < sound.size(); at += sound.size() / 5) {
      Bytes bytes = sound;
      bytes[at] ^= 1;
      write_file_atomic(package / name, bytes);
      EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "artifact.hash") << name << ' ' << at;
    }
    write_file_atomic(package / name, sound);
  }
}

}  // namespace
}  // namespace nadir
