// Through the plug-in interface with a fake behind it, and through the real plug-in and ONNX Runtime with a model that
// is written here.
#include "vision/network_plugin.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "support/onnx_writer.hpp"
#include "support/temporary_folder.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using namespace test;
using testing::HasSubstr;

class NetworkPlugins : public testing::Test {
 protected:
  NetworkFile model(const TinyModel& tiny = {}) const {
    const auto path = folder_.path() / "tiny.onnx";
    write_file_atomic(path, onnx_model(tiny));
    return {path, std::nullopt};
  }
  static std::string complaint(const NetworkFile& file, const std::filesystem::path& plugins) {
    try {
      open_network(file, {plugins});
      return "accepted";
    } catch (const Error& error) {
      return error.what();
    }
  }

  TemporaryFolder folder_;
};

TEST_F(NetworkPlugins, OpensANetworkByItsDigest) {
  NetworkFile file = model();
  file.digest = sha256_file(file.model);
  const OpenedNetwork opened = open_network(file, {"/nowhere", FAKE_NETWORK_PLUGINS});
  EXPECT_EQ(opened.digest, *file.digest);
  EXPECT_EQ(opened.runtime, "Fake Runtime 1.0");
  EXPECT_EQ(opened.network->channels(), 8);
  EXPECT_THAT(opened.network->name(), HasSubstr("tiny.onnx (" + file.digest->hex().substr(0, 12)));
  EXPECT_EQ(opened.network->describe(cv::Mat(64, 96, CV_8UC1, cv::Scalar(3))).size(), cv::Size(12, 8));
}

TEST_F(NetworkPlugins, SaysWhatIsMissing) {
  EXPECT_THAT(complaint({folder_.path() / "none.onnx", std::nullopt}, FAKE_NETWORK_PLUGINS), HasSubstr("none.onnx"));
  EXPECT_THAT(complaint(model(), folder_.path()), HasSubstr("network plug-in not installed"));
  EXPECT_THAT(complaint(model(), LIBRARYLESS_NETWORK_PLUGINS), HasSubstr("libonnxruntime.so.1: cannot open"));
  EXPECT_THAT(complaint(model(), OLD_NETWORK_PLUGINS), HasSubstr("version 999"));
  write_file_atomic(folder_.path() / "nadir_network_onnxruntime.so", std::string_view("no library"));
  EXPECT_THAT(complaint(model(), folder_.path()), HasSubstr("cannot load the network plug-in"));
}

TEST_F(NetworkPlugins, AnotherModelIsNotLoaded) {
  NetworkFile file = model();
  file.digest = Sha256{};
  EXPECT_THAT(complaint(file, "/nowhere"), HasSubstr("not the one that was chosen"));  // before any plug-in is
}

TEST_F(NetworkPlugins, SaysWhatIsWrongWithWhatItGives) {
  const auto with_input = [&](const std::string& name) {
    return complaint(model({.input = name}), FAKE_NETWORK_PLUGINS);
  };
  EXPECT_EQ(with_input("input"), "accepted");
  EXPECT_THAT(with_input("unknown operator"), HasSubstr("no kernel for it"));
  EXPECT_THAT(with_input("fails"), HasSubstr("out of memory"));
  EXPECT_THAT(with_input("nan"), HasSubstr("NaN"));
  EXPECT_THAT(with_input("half"), HasSubstr("1 x 8 x 4 x 8"));
  EXPECT_THAT(with_input("nothing"), HasSubstr("gives what it should not"));
  const OpenedNetwork later = open_network(model({.input = "fails later"}), {FAKE_NETWORK_PLUGINS});
  EXPECT_THROW(later.network->describe(cv::Mat(64, 64, CV_8UC1, cv::Scalar(0))), Error);
}

TEST_F(NetworkPlugins, CostIsTheLeastOfAFewRuns) {
  const OpenedNetwork opened = open_network(model(), {FAKE_NETWORK_PLUGINS});
  double now_s = 0, step_s = 0.01;
  EXPECT_NEAR(network_cost_ms(*opened.network,
                              [&] {
                                now_s += step_s;
                                step_s *= 1.1;
                                return now_s;
                              }),
              1e3 * 0.01 * 1.21, 1e-6);
}

// The plug-in that is installed, and ONNX Runtime.
class OnnxRuntime : public NetworkPlugins {
 protected:
  void SetUp() override {
    const auto folder = std::filesystem::path(NETWORK_PLUGINS);
    if (!std::filesystem::exists(folder / "nadir_network_onnxruntime.so")) {
      GTEST_SKIP() << "NOT TESTED: the network plug-in is not built: no header of ONNX Runtime (docs/building.md)";
    }
    if (!std::filesystem::exists(folder / "libonnxruntime.so.1")) {
      GTEST_SKIP() << "NOT TESTED: ONNX Runtime is not installed in the build's Python environment";
    }
  }
  static std::filesystem::path plugins() { return NETWORK_PLUGINS; }
};

// The model is written by hand, so what it gives is known: |sum of an edge's filter| over 8 x 8 pixels.
TEST_F(OnnxRuntime, RunsAModel) {
  const OpenedNetwork opened = open_network(model({.input_channels = 3}), {plugins()});
  EXPECT_THAT(opened.runtime, HasSubstr("ONNX Runtime 1."));
  cv::Mat picture(64, 96, CV_8UC1, cv::Scalar(0));
  picture(cv::Rect(0, 0, 20, 64)).setTo(255);  // an edge in the middle of the third cell of each row
  const cv::Mat cells = opened.network->describe(picture);
  ASSERT_EQ(cells.size(), cv::Size(12, 8));
  ASSERT_EQ(cells.type(), CV_32FC(8));
  for (int r = 0; r < 8; ++r) {
    for (int c = 0; c < 12; ++c) {
      // Three equal channels of eight rows of 255 / 255 in the half of an edge between columns.
      EXPECT_NEAR(cells.ptr<float>(r)[c * 8], c == 2 ? 3 * 8 * 4 : 0, 1e-3) << r << " " << c;
      // And none between rows, of which as many are of either sign.
      EXPECT_NEAR(cells.ptr<float>(r)[c * 8 + 1], 0, 1e-3);
    }
  }
}

TEST_F(OnnxRuntime, TheSamePictureGivesTheSameBits) {
  const OpenedNetwork one = open_network(model(), {plugins()}), other = open_network(model(), {plugins()});
  const cv::Mat picture = Landscape(4, 200).map(1.0).image(cv::Rect(0, 0, 320, 256)).clone();
  const cv::Mat cells = one.network->describe(picture);
  other.network->describe(cv::Mat(32, 32, CV_8UC1, cv::Scalar(9)));
  EXPECT_EQ(cv::norm(cells, other.network->describe(picture), cv::NORM_INF), 0);
}

TEST_F(OnnxRuntime, SaysWhatItDoesNotLoad) {
  // Its outputs are half as large.
  EXPECT_THAT(complaint(model({.stride = 16}), plugins()), HasSubstr("1 x 8 x 4 x 4"));
  // Weights that are no numbers give descriptors that are none.
  EXPECT_THAT(complaint(model({.factor = std::numeric_limits<float>::infinity()}), plugins()), HasSubstr("NaN"));
  // A name that nothing in the graph has.
  const std::string bytes = onnx_model();
  std::string renamed = bytes;
  renamed.replace(renamed.find("sums"), 4, "none");
  write_file_atomic(folder_.path() / "renamed.onnx", renamed);
  EXPECT_THAT(complaint({folder_.path() / "renamed.onnx", std::nullopt}, plugins()),
              HasSubstr("the network cannot be loaded"));
}

}  // namespace
}  // namespace nadir
