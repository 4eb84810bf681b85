#include <gtest/gtest.h>
#include <unistd.h>

#include "base/error.hpp"
#include "package_build/package_builder_fixture.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::ResumedBuild;

// A file system that is too small for the package; growing it lets the same build end.
TEST_F(ResumedBuild, AFullDiskLosesNothing) {
  const fs::path small = folder_ / "map.small";
  fs::create_directory(small);
  if (::geteuid() != 0 ||
      test::run_process({"mount", "-t", "tmpfs", "-o", "size=600k", "tmpfs", small.string()}).code != 0) {
    GTEST_SKIP() << "NOT TESTED: a full disk needs root and a tmpfs to mount";
  }
  const struct Unmount {
    ~Unmount() { test::run_process({"umount", "-l", path.string()}); }
    fs::path path;
  } unmount{small};
  ASSERT_FALSE(build(request("whole")).findings.refuses());
  PackageRequest wanted = resuming("map.small/package");
  try {
    build(wanted);
    FAIL() << "600 kB are enough";
  } catch (const OutOfSpace& error) {
    EXPECT_THAT(error.text().fix, testing::HasSubstr("--resume"));
  }
  EXPECT_FALSE(fs::exists(wanted.out));
  ASSERT_EQ(test::run_process({"mount", "-o", "remount,size=64m", small.string()}).code, 0);
  EXPECT_GT(build(wanted).resumed, 0);
  expect_same_files(folder_ / "whole", wanted.out);
}

TEST_F(ResumedBuild, AReadOnlyMediumIsNamed) {
  const fs::path fixed = folder_ / "map.fixed";
  fs::create_directory(fixed);
  if (::geteuid() != 0 ||
      test::run_process({"mount", "-t", "tmpfs", "-o", "ro,size=64k", "tmpfs", fixed.string()}).code != 0) {
    GTEST_SKIP() << "NOT TESTED: a read-only medium needs root and a tmpfs to mount";
  }
  try {
    build(request("map.fixed/package"));
    ADD_FAILURE() << "built on a read-only medium";
  } catch (const Error& error) {
    EXPECT_THAT(error.text().found + error.text().fix, testing::HasSubstr("read-only"));
  }
  test::run_process({"umount", "-l", fixed.string()});
}

TEST_F(ResumedBuild, AFolderWithoutPermissionIsNamed) {
  if (::geteuid() != 0) GTEST_SKIP() << "NOT TESTED: a folder of somebody else needs root to make";
  fs::permissions(folder_.path(), static_cast<fs::perms>(0755));
  const auto result = run_build(request("package"), 0, "65534");
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.err, testing::HasSubstr("package"));
  EXPECT_THAT(result.err, testing::HasSubstr("check the permissions"));
  EXPECT_THAT(left_behind(), testing::IsEmpty());
}

}  // namespace
}  // namespace nadir
