// The matchability map of a package: it belongs to what was signed, and a flight does without one that it cannot read.
#include <gtest/gtest.h>

#include "base/files.hpp"
#include "package/open_package.hpp"
#include "package/package_maker.hpp"

namespace nadir {
namespace {

class PackageWithMatchability : public testing::Test {
 protected:
  // Nothing: a package without one.
  Opening open(const std::optional<Bytes>& map) {
    if (map) {
      maker_.edit_manifest = [&](Manifest& manifest) {
        const auto package = folder_ / "package";
        std::filesystem::create_directories(package / "matchability");
        write_file_atomic(package / kMatchabilityFile, *map);
        manifest.artifacts.push_back(describe_file(package, kMatchabilityFile, kRoleMatchability));
      };
    }
    package_ = maker_.make(folder_);
    return open_again();
  }
  Opening open_again() {
    NoProgress progress;
    return open_package(package_, maker_.options(), progress);
  }
  static Bytes sound() { return read_file(std::filesystem::path(NADIR_MATCHABILITY_SAMPLE)); }

  test::TemporaryFolder folder_;
  test::PackageMaker maker_;
  std::filesystem::path package_;
};

TEST_F(PackageWithMatchability, IsReadWithThePackage) {
  const Opening opening = open(sound());
  ASSERT_TRUE(opening.package) << test::codes(opening.findings);
  ASSERT_NE(opening.package->matchability(), nullptr);
  EXPECT_EQ(opening.package->matchability()->cells().columns, 3);
  EXPECT_EQ(test::codes(opening.findings), "");
}

TEST_F(PackageWithMatchability, WithoutOneThereIsNoFinding) {
  const Opening opening = open(std::nullopt);
  ASSERT_TRUE(opening.package);
  EXPECT_EQ(opening.package->matchability(), nullptr);
  EXPECT_EQ(test::codes(opening.findings), "");
}

TEST_F(PackageWithMatchability, ASignedFileThatIsNoMapIsAWarningAndTheFlightGoesOn) {
  const Opening opening = open(Bytes(500, 0x49));
  ASSERT_TRUE(opening.package) << test::codes(opening.findings);
  EXPECT_EQ(opening.package->matchability(), nullptr);
  ASSERT_TRUE(opening.findings.contains("matchability.corrupt"));
  EXPECT_FALSE(opening.findings.has_errors());
}

TEST_F(PackageWithMatchability, BytesThatWereNotSignedAreRefused) {
  ASSERT_TRUE(open(sound()).package);
  Bytes bytes = read_file(package_ / kMatchabilityFile);
  bytes.back() ^= 1;
  write_file_atomic(package_ / kMatchabilityFile, bytes);
  const Opening opening = open_again();
  EXPECT_FALSE(opening.package);
  EXPECT_TRUE(opening.findings.contains("artifact.hash")) << test::codes(opening.findings);
}

}  // namespace
}  // namespace nadir
