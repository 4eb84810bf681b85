// What the tests of verify_package() share: a maker of packages, a folder, and what to expect.
#pragma once

#include <gtest/gtest.h>

#include <fstream>
#include <functional>

#include "base/files.hpp"
#include "package/package_maker.hpp"

namespace nadir::test {

class Verify : public ::testing::Test {
 protected:
  static void overwrite(const std::filesystem::path& file, const Bytes& bytes) {
    std::ofstream(file, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  }
  static void flip(const std::filesystem::path& file, std::size_t at, std::uint8_t bit = 1) {
    Bytes bytes = read_file(file);
    bytes.at(at) ^= bit;
    overwrite(file, bytes);
  }
  void expect(const char* code, const Verification& verification) {
    EXPECT_TRUE(verification.findings.contains(code)) << code << " not among: " << codes(verification.findings);
    EXPECT_FALSE(verification.accepted());
  }
  void expect_only(const char* code, const Verification& verification) {
    expect(code, verification);
    for (const Finding& finding : verification.findings.items()) EXPECT_EQ(finding.code, code) << finding.where;
  }
  Verification with_options(const std::filesystem::path& package, const VerifyOptions& options) {
    NoProgress progress;
    return verify_package(package, options, progress);
  }

  // Signs another description of the imagery.
  void sign_imagery(const std::filesystem::path& package, const std::function<void(Artifact&)>& edit) {
    Manifest manifest = *parse_manifest(read_file(package / kManifestFile)).manifest;
    for (Artifact& artifact : manifest.artifacts) {
      if (artifact.role == kRoleImagery) edit(artifact);
    }
    write_file_atomic(package / kManifestFile, manifest_json(manifest));
    maker_.sign(package);
  }
  // Rows that were added or exchanged may have made the file longer, and that alone would refuse it.
  void sign_sizes(const std::filesystem::path& package) {
    sign_imagery(package,
                 [&](Artifact& artifact) { artifact.size = std::filesystem::file_size(package / artifact.path); });
  }
  static Findings before_signing(const std::filesystem::path& package) {
    NoProgress progress;
    return check_before_signing(package, progress);
  }

  TemporaryFolder folder_;
  PackageMaker maker_;
};

}  // namespace nadir::test
