// nadir cache index --evaluate DIR: the recall of an index over a flight whose truth is known.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <sstream>

#include "base/csv.hpp"
#include "base/files.hpp"
#include "cli/program.hpp"
#include "imagery/codecs.hpp"
#include "package/package_maker.hpp"
#include "commands/commands.hpp"
#include "support/process.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::string_view kCamera = R"(model: pinhole
width: 160
height: 120
fx: 160
fy: 160
cx: 80
cy: 60
distortion: []
uncertainty: {heading_deg: 3.0, agl_relative: 0.02, tilt_deg: 0.5}
)";

// A landscape that is the same at every zoom: fields of 14 m of different brightness, some of them in stripes.
Bytes landscape_tile(const TileKey& key) {
  cv::Mat image(kTileSize, kTileSize, CV_8UC3);
  const std::uint32_t step = 1U << (18 - key.z);  // pixels of zoom 18, 0.4 m
  for (int row = 0; row < kTileSize; ++row) {
    for (int column = 0; column < kTileSize; ++column) {
      const std::uint32_t x = (key.x * kTileSize + static_cast<std::uint32_t>(column)) * step;
      const std::uint32_t y = (key.y * kTileSize + static_cast<std::uint32_t>(row)) * step;
      std::uint32_t field = (x / 36) * 73856093U ^ (y / 36) * 19349663U;
      field = (field ^ field >> 13) * 0x5bd1e995U;
      const bool stripe = field % 3 == 0 && (field % 2 == 0 ? x : x + y) / 9 % 2 == 0;
      const auto grey = static_cast<std::uint8_t>(60 + field / 7 % 120 + (stripe ? 60 : 0));
      image.at<cv::Vec3b>(row, column) = {grey, grey, grey};
    }
  }
  return encode_image(image, ImageFormat::jpeg, 80);
}

class IndexEvaluation : public ::testing::Test {
 protected:
  // A package, its index, and a flight over its own pictures.
  void SetUp() override {
    if (test::run_shell("command -v gdal_translate").code != 0) GTEST_SKIP() << "NOT TESTED: no gdal_translate";
    maker_.edit_tile = [](Sidecar& sidecar, Bytes& tile) {
      tile = landscape_tile(sidecar.key);
      return true;
    };
    maker_.make(folder_, "package");
    write_file_atomic(folder_ / "p.key.pem", maker_.signer.pem(), 0600);
    folder_.write("camera.yaml", std::string(kCamera));
    const auto cut = test::run_process({"gdal_translate", "-q", "-of", "GTiff", "-b", "1", "-b", "2", "-b", "3",
                                        folder_ / "package/imagery/base.mbtiles", folder_ / "world.tif"});
    ASSERT_EQ(cut.code, 0) << cut.err;
    ASSERT_EQ(run({"cache", "index", "@package", "--key", "@p.key.pem", "--camera", "@camera.yaml", "--overlap-percent", "50"}),
              0)
        << err_.str();
    ASSERT_EQ(run({"simulate", "flight", "--world", "@world.tif", "--mission", "@package/mission/mission.yaml",
                   "--camera", "@camera.yaml", "--frames", "6", "--interval-s", "1", "--out", "@flight"}),
              0)
        << err_.str();
  }
  int run(std::vector<std::string> args) {
    for (std::string& arg : args) {
      if (arg.starts_with('@')) arg = (folder_ / arg.substr(1)).string();
    }
    out_.str("");
    err_.str("");
    return run_program(nadir_text(), all_commands(), args, {out_, err_, clock_});
  }
  json evaluate(std::initializer_list<std::string> more = {}) {
    std::vector<std::string> args{"cache", "index", "@package", "--evaluate", "@flight", "--json"};
    args.insert(args.end(), more);
    EXPECT_EQ(run(args), 0) << err_.str();
    return json::parse(out_.str());
  }
  // Exit code 2, a message that names what is meant, and a package that stays as it was.
  void expect_bad(const std::string& folder, const std::string& says) {
    EXPECT_EQ(run({"cache", "index", "@package", "--evaluate", "@" + folder}), 2) << says;
    EXPECT_NE(err_.str().find(says), std::string::npos) << err_.str();
    EXPECT_TRUE(out_.str().empty());
  }
  std::string text(const std::string& name) const { return read_text_file(folder_ / name); }

  test::TemporaryFolder folder_;
  FixedClock clock_{test::kJudged};
  std::ostringstream out_, err_;
  test::PackageMaker maker_;
};

TEST_F(IndexEvaluation, CountsFramesRecalledAtEachRank) {
  const Sha256 before = sha256_file(folder_ / "package/manifest.json");
  const std::size_t frames = CsvTable::read(folder_ / "flight/telemetry.csv").rows();
  ASSERT_GE(frames, 5U);
  const json report = evaluate();
  for (const char* heading : {"heading_known", "heading_unknown"}) {
    const json& recall = report[heading];
    EXPECT_EQ(recall["queries"], frames) << heading;
    const double at_1 = recall["recall_at_1"], at_5 = recall["recall_at_5"], at_20 = recall["recall_at_20"];
    EXPECT_TRUE(0 <= at_1 && at_1 <= at_5 && at_5 <= at_20 && at_20 <= 1) << recall;
    for (const double share : {at_1, at_5, at_20}) {  // of whole frames
      EXPECT_NEAR(share * static_cast<double>(frames), std::round(share * static_cast<double>(frames)), 1e-9);
    }
    const double chance = recall["chance_at_5"];
    EXPECT_TRUE(chance > 0 && chance < 1) << recall;
    EXPECT_GE(recall["query_ms_max"], recall["query_ms_p50"]);
  }
  EXPECT_GE(report["heading_known"]["recall_at_1"], 0.5) << report;
  EXPECT_GE(report["heading_known"]["recall_at_5"], 0.75) << report;
  EXPECT_EQ(report["left_out"], 0);
  EXPECT_EQ(report["heading_range_deg"], 15);
  EXPECT_EQ(report["against"], (folder_ / "flight").string());
  EXPECT_EQ(sha256_file(folder_ / "package/manifest.json"), before);
  // The same seed asks the same, and the text says the same.
  ASSERT_EQ(run({"cache", "index", "@package", "--evaluate", "@flight"}), 0);
  const auto text = fmt::format("recall@1 {:.1f} %", 100 * report["heading_known"]["recall_at_1"].get<double>());
  EXPECT_NE(out_.str().find(text), std::string::npos) << out_.str();
}

// With a truth somewhere else no answer is right, and chance knows it as well.
TEST_F(IndexEvaluation, SkipsFramesWithoutTruthOrImage) {
  const CsvTable truth = CsvTable::read(folder_ / "flight/truth.csv");
  std::string elsewhere = "frame,lat_deg,lon_deg\n";
  for (std::size_t row = 0; row + 2 < truth.rows(); ++row) {
    elsewhere += truth.cell(row, truth.required_column("frame")) + ",48.1,11.2\n";
  }
  folder_.write("flight/truth.csv", elsewhere);
  // A damaged picture is no hindrance either; what is left of it may still be a picture.
  const fs::path picture = folder_ / "flight/frames/frame_0003.jpg";
  fs::resize_file(picture, fs::file_size(picture) / 3);
  const json report = evaluate();
  const std::size_t left_out = report["left_out"];
  EXPECT_TRUE(left_out == 2 || left_out == 3) << left_out;
  EXPECT_EQ(report["heading_known"]["queries"], truth.rows() - left_out);
  for (const char* heading : {"heading_known", "heading_unknown"}) {
    EXPECT_EQ(report[heading]["recall_at_20"], 0);
    EXPECT_EQ(report[heading]["chance_at_5"], 0);
  }
}

TEST_F(IndexEvaluation, NamesFoldersThatAreNotFlights) {
  fs::create_directory(folder_ / "empty");
  expect_bad("empty", "camera.yaml");
  expect_bad("nowhere", "nowhere");
  expect_bad("world.tif", "world.tif");
  const auto spoilt = [&](const std::string& name, const std::function<void(const fs::path&)>& spoil,
                          const std::string& says) {
    SCOPED_TRACE(name);
    fs::copy(folder_ / "flight", folder_ / name, fs::copy_options::recursive);
    spoil(folder_ / name);
    expect_bad(name, says);
  };
  spoilt(
      "no_truth", [](const fs::path& at) { fs::remove(at / "truth.csv"); }, "truth.csv");
  spoilt(
      "no_camera", [](const fs::path& at) { fs::remove(at / "camera.yaml"); }, "camera.yaml");
  spoilt(
      "no_frames", [](const fs::path& at) { fs::remove_all(at / "frames"); }, "frames");
  spoilt(
      "no_telemetry", [](const fs::path& at) { fs::remove(at / "telemetry.csv"); }, "telemetry.csv");
  const std::string frame = "frame_0003.jpg";
  for (const auto& [name, truth] : {std::pair{"nan", "frame,lat_deg,lon_deg\n" + frame + ",nan,11\n"},
                                    {"far", "frame,lat_deg,lon_deg\n" + frame + ",95,11\n"},
                                    {"other", std::string("frame,lat_deg,lon_deg\nother.jpg,48,11\n")},
                                    {"twice", "frame,lat_deg,lon_deg\n" + frame + ",48,11\n" + frame + ",48,11\n"},
                                    {"short", "frame,lat_deg\n" + frame + ",48\n"},
                                    {"none", std::string()}}) {
    spoilt(
        std::string("truth_") + name,
        [&, text = truth](const fs::path& at) { write_file_atomic(at / "truth.csv", text); }, "truth.csv");
  }
  EXPECT_TRUE(maker_.verify(folder_ / "package", VerifyDepth::full).findings.empty());
}

}  // namespace
}  // namespace nadir
