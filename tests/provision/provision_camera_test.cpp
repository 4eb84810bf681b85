// `nadir provision camera` as a user calls it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "provision/board_scene.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"
#include "vision/camera.hpp"

namespace nadir {
namespace {

using testing::HasSubstr;

test::ProcessResult provision(const std::filesystem::path& pictures, const std::filesystem::path& out) {
  return test::run_process({NADIR_PROGRAM, "provision", "camera", "--images", pictures, "--board", "9x6", "--square-m",
                            "0.025", "--out", out});
}

TEST(ProvisionCamera, WritesACameraFileOnceAndNeverReplacesIt) {
  const test::TemporaryFolder folder;
  const CameraModel truth = test::test_camera();
  test::write_pictures(folder / "board", truth, test::good_poses(truth), 0.6);
  const auto result = provision(folder / "board", folder / "camera.yaml");
  ASSERT_EQ(result.code, 0) << result.out << result.err;
  EXPECT_EQ(result.err, "");
  EXPECT_THAT(result.out, HasSubstr("12 used, 0 rejected"));
  const CameraModel camera = read_camera_file(folder / "camera.yaml").camera;
  EXPECT_EQ(camera.width, truth.width);
  EXPECT_NEAR(camera.fx, truth.fx, 0.003 * truth.fx);

  const auto again = provision(folder / "board", folder / "camera.yaml");
  EXPECT_EQ(again.code, 2);
  EXPECT_THAT(again.err, HasSubstr("already exists"));
}

TEST(ProvisionCamera, TooFewImagesAreExplainedAndNothingIsWritten) {
  const test::TemporaryFolder folder;
  const CameraModel truth = test::test_camera();
  auto poses = test::good_poses(truth);
  poses.resize(2);
  test::write_pictures(folder / "board", truth, poses, 4);
  const auto result = provision(folder / "board", folder / "camera.yaml");
  EXPECT_EQ(result.code, 1) << result.err;
  EXPECT_THAT(result.out, HasSubstr("provision.few_pictures"));
  EXPECT_THAT(result.out, HasSubstr("00.png"));
  EXPECT_THAT(result.out, HasSubstr("blurred"));
  EXPECT_FALSE(std::filesystem::exists(folder / "camera.yaml"));
}

}  // namespace
}  // namespace nadir
