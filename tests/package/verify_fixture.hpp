// What the tests of verify_package() share: a maker of packages, a folder, and what to expect.
#pragma once

#include <gtest/gtest.h>

#include <fstream>

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

  TemporaryFolder folder_;
  PackageMaker maker_;
};

}  // namespace nadir::test
