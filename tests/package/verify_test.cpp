// Signature, manifest and policy: one test per finding, so that the fault that it names is caught and nothing else
// hides it.
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "package/verify_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::codes;
using test::mission_yaml;
using test::PackageMaker;
using test::Verify;

TEST_F(Verify, AcceptsASoundPackage) {
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

TEST_F(Verify, RefusesEveryFlippedBitOfTheSignatureFile) {
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
  const PackageMaker stranger;
  expect_only("key.unknown", maker_.verify(stranger.make(folder_)));
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

TEST_F(Verify, ManifestSchemaForAnEndlessManifest) {
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

}  // namespace
}  // namespace nadir
