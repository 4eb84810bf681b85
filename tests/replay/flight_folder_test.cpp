// Inputs of a replay: what is read, and that everything wrong is refused with its place.
#include "replay/flight_folder.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "replay/score.hpp"
#include "support/temporary_folder.hpp"
#include "support/tiff_writer.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr const char* kHeader = "frame,time_s,agl_m,heading_deg,pitch_deg,roll_deg\n";

class FlightFolder : public ::testing::Test {
 protected:
  FlightFolder() {
    fs::create_directory(folder_ / "frames");
    picture("a.jpg", 64, 48);
    picture("b.jpg", 64, 48);
    folder_.write("camera.yaml",
                  "model: pinhole\nwidth: 64\nheight: 48\nfx: 60.0\nfy: 60.0\ncx: 32.0\ncy: 24.0\ndistortion: []\n"
                  "uncertainty: {heading_deg: 3.0, agl_relative: 0.05, tilt_deg: 1.0}\n");
    telemetry("a.jpg,0.0,120,90,1.5,-2\nb.jpg,1.5,121,,,\n");
  }

  void picture(const std::string& name, int width, int height) {
    const Bytes bytes = encode_image(cv::Mat(height, width, CV_8UC3, cv::Scalar(90, 120, 60)), ImageFormat::jpeg);
    write_file_atomic(folder_ / "frames" / name, ByteView(bytes));
  }
  void telemetry(const std::string& rows) { folder_.write("telemetry.csv", kHeader + rows); }
  Flight read() { return read_flight({folder_ / "frames", folder_ / "telemetry.csv", folder_ / "camera.yaml"}); }
  std::string complaint() {
    try {
      read();
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  test::TemporaryFolder folder_;
};

constexpr const char* kInertialHeader =
    "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_mps2,accel_y_mps2,accel_z_mps2\n";

TEST_F(FlightFolder, FramesGetTheInertialSamplesSinceTheOneBefore) {
  EXPECT_TRUE(read().frames[1].inertial.empty()) << "there is no file";
  std::string rows;
  for (int i = -10; i < 200; ++i) rows += fmt::format("{:.2f},0.1,0.2,{:.3f},1,2,-9.8\n", i / 100.0, i / 1000.0);
  folder_.write("imu.csv", kInertialHeader + rows);
  const Flight flight = read();
  EXPECT_TRUE(flight.frames[0].inertial.empty());
  const auto& samples = flight.frames[1].inertial;
  ASSERT_EQ(samples.size(), 150U);
  EXPECT_EQ(samples.front().time_s, 0.01);
  EXPECT_EQ(samples.back().time_s, 1.5);
  EXPECT_EQ(samples.back().rate_rad_s, Eigen::Vector3d(0.1, 0.2, 0.15));
  EXPECT_EQ(samples.back().force_mps2, Eigen::Vector3d(1, 2, -9.8));
}

TEST_F(FlightFolder, RefusesInertialSamplesThatCannotBeMeant) {
  const auto complaint_of = [&](const std::string& text) {
    folder_.write("imu.csv", text);
    return complaint();
  };
  const std::string header = kInertialHeader;
  EXPECT_THAT(complaint_of("time_s,gyro_x_rad_s\n0,0\n"), ::testing::HasSubstr("gyro_y_rad_s"));
  EXPECT_THAT(complaint_of(header), ::testing::HasSubstr("no inertial samples"));
  EXPECT_THAT(complaint_of(header + "0,0,0,0,0,0,nan\n"), ::testing::HasSubstr("imu.csv"));
  EXPECT_THAT(complaint_of(header + "0,0,0,0,0,0,-9.8\n0,0,0,0,0,0,-9.8\n"),
              ::testing::AllOf(::testing::HasSubstr("imu.csv:3"), ::testing::HasSubstr("order of time")));
  EXPECT_THAT(complaint_of(header + "0,0,0,0,0,0,-9.8\n1,0,0,0,0,0,-9.8\n2,0,0,0,0,0,-9.8\n"),
              ::testing::HasSubstr("too far apart"));
  EXPECT_THAT(complaint_of(header + "100,0,0,0,0,0,-9.8\n100.01,0,0,0,0,0,-9.8\n"),
              ::testing::HasSubstr("no inertial sample is of the time of the flight"));
}

TEST_F(FlightFolder, ReadsTiffFrames) {
  const cv::Mat image(48, 64, CV_8UC3, cv::Scalar(90, 120, 60));
  test::write_tiff(folder_ / "frames" / "c.tif", image);
  telemetry("a.jpg,0.0,120,90,1.5,-2\nc.tif,1.5,121,,,\n");
  const Flight flight = read();
  ASSERT_EQ(flight.frames.size(), 2U);
  const cv::Mat grey = read_flight_image(flight.image_path(1), flight.camera.camera, 1);
  ASSERT_EQ(grey.size(), cv::Size(64, 48));
  EXPECT_NEAR(grey.at<std::uint8_t>(5, 5), 0.114 * 90 + 0.587 * 120 + 0.299 * 60, 1);
}

TEST_F(FlightFolder, HeicIsNamedAndNotMissing) {
  folder_.write("frames/c.HEIC", "");
  telemetry("a.jpg,0.0,120,90,1.5,-2\nc.HEIC,1.5,121,,,\n");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("HEIC is not supported: convert to JPEG"));
  fs::remove(folder_ / "frames/a.jpg");
  fs::remove(folder_ / "frames/b.jpg");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("HEIC is not supported: convert to JPEG"));
}

TEST_F(FlightFolder, ReadsRowsWithUnknownCells) {
  const Flight flight = read();
  ASSERT_EQ(flight.frames.size(), 2U);
  EXPECT_DOUBLE_EQ(*flight.frames[0].heading_rad, kPi / 2);
  EXPECT_DOUBLE_EQ(*flight.frames[0].roll_rad, radians(-2));
  EXPECT_EQ(flight.frames[1].time_s, 1.5);
  EXPECT_EQ(flight.frames[1].pitch_rad, std::nullopt);
  EXPECT_EQ(flight.camera.camera.width, 64);
}

TEST_F(FlightFolder, ReadsTheTurnRateIfWhole) {
  const std::string header =
      "frame,time_s,agl_m,heading_deg,pitch_deg,roll_deg,roll_rate_deg_s,pitch_rate_deg_s,yaw_rate_deg_s\n";
  folder_.write("telemetry.csv", header + "a.jpg,0,120,90,1,-2,30,-10,5\nb.jpg,1.5,121,,,,30,,5\n");
  const Flight flight = read();
  ASSERT_TRUE(flight.frames[0].rate_rad_s);
  EXPECT_DOUBLE_EQ(flight.frames[0].rate_rad_s->x(), radians(30));
  EXPECT_DOUBLE_EQ(flight.frames[0].rate_rad_s->z(), radians(5));
  EXPECT_FALSE(flight.frames[1].rate_rad_s) << "one of them is unknown";
  folder_.write("telemetry.csv", header + "a.jpg,0,120,90,1,-2,3000,0,0\nb.jpg,1.5,121,,,,0,0,0\n");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("roll_rate_deg_s is out of range"));
}

TEST_F(FlightFolder, ReadsTheVelocityChangeIfPresent) {
  const std::string header = "frame,time_s,agl_m,heading_deg,pitch_deg,roll_deg,imu_dv_east_mps,imu_dv_north_mps\n";
  folder_.write("telemetry.csv", header + "a.jpg,0,120,90,1,-2,,\nb.jpg,1.5,121,,,,-3.25,0.5\n");
  const Flight flight = read();
  EXPECT_EQ(flight.frames[0].imu_dv_mps, std::nullopt);
  EXPECT_EQ(flight.frames[1].imu_dv_mps, Eigen::Vector2d(-3.25, 0.5));
  folder_.write("telemetry.csv", header + "a.jpg,0,120,90,1,-2,,\nb.jpg,1.5,121,,,,-3.25,\n");
  EXPECT_EQ(read().frames[1].imu_dv_mps, std::nullopt) << "half of it is unknown";
  folder_.write("telemetry.csv", header + "a.jpg,0,120,90,1,-2,1e9,0\nb.jpg,1.5,121,,,,0,0\n");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("imu_dv_east_mps is out of range"));
  folder_.write("telemetry.csv", header + "a.jpg,0,120,90,1,-2,0,nan\nb.jpg,1.5,121,,,,0,0\n");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("telemetry.csv:2"));
  folder_.write("telemetry.csv",
                "frame,time_s,agl_m,heading_deg,pitch_deg,roll_deg,imu_dv_north_mps\na.jpg,0,9,,,,0\n");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("only imu_dv_north_mps"));
}

TEST_F(FlightFolder, CountsImagesWithoutARow) {
  telemetry("a.jpg,0,120,90,,\n");
  EXPECT_EQ(read().images_without_row, 1U);
}

TEST_F(FlightFolder, RejectsNan) {
  telemetry("a.jpg,0,nan,90,,\nb.jpg,1,121,,,\n");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("telemetry.csv:2"));
}

TEST_F(FlightFolder, RejectsUnorderedRows) {
  telemetry("b.jpg,1.5,121,,,\na.jpg,0,120,90,,\n");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("order of time"));
}

TEST_F(FlightFolder, RejectsDuplicateTimesAndFrames) {
  telemetry("a.jpg,0,120,90,,\nb.jpg,0,121,,,\n");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("order of time"));
  telemetry("a.jpg,0,120,90,,\na.jpg,1,121,,,\n");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("two rows"));
}

TEST_F(FlightFolder, RejectsUnknownFrames) {
  telemetry("a.jpg,0,120,90,,\nc.jpg,1,121,,,\n");
  EXPECT_THAT(complaint(), ::testing::AllOf(::testing::HasSubstr("c.jpg"), ::testing::HasSubstr("missing")));
  telemetry("../a.jpg,0,120,90,,\n");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("invalid name"));
}

TEST_F(FlightFolder, RejectsImpossibleValues) {
  for (const char* row :
       {"a.jpg,0,-5,90,,", "a.jpg,0,120,900,,", "a.jpg,0,120,90,95,", "a.jpg,,120,90,,", "a.jpg,0,120,90,,,"}) {
    telemetry(std::string(row) + "\n");
    EXPECT_NE(complaint(), "") << row;
  }
}

TEST_F(FlightFolder, RejectsEmptyInputs) {
  telemetry("");
  EXPECT_NE(complaint(), "");
  telemetry("a.jpg,0,120,90,,\n");
  fs::remove_all(folder_ / "frames");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("cannot be read"));
  fs::create_directory(folder_ / "frames");
  EXPECT_THAT(complaint(), ::testing::HasSubstr("no images"));
}

TEST_F(FlightFolder, RejectsImagesOfAnotherSize) {
  picture("b.jpg", 48, 64);
  EXPECT_THAT(complaint(), ::testing::AllOf(::testing::HasSubstr("64×48"), ::testing::HasSubstr("48×64"),
                                            ::testing::HasSubstr("b.jpg")));
}

TEST_F(FlightFolder, RejectsFilesThatAreNotImages) {
  write_file_atomic(folder_ / "frames" / "b.jpg", std::string_view("not a picture"));
  EXPECT_THAT(complaint(), ::testing::HasSubstr("b.jpg"));
  write_file_atomic(folder_ / "frames" / "b.jpg", std::string_view(""));
  EXPECT_NE(complaint(), "");
}

TEST_F(FlightFolder, TruthMayCoverPartOfTheFlight) {
  const auto frames = read().frames;
  const Truth truth =
      read_truth(folder_.write("t.csv", "frame,lat_deg,lon_deg\nb.jpg,24.5,120.5\nz.jpg,1,1\n"), frames);
  EXPECT_EQ(truth[0], std::nullopt);
  EXPECT_EQ(truth[1], (LonLat{120.5, 24.5}));
  EXPECT_THROW(read_truth(folder_.write("t.csv", "frame,lat_deg,lon_deg\nz.jpg,24.5,120.5\n"), frames), UsageError);
  EXPECT_THROW(read_truth(folder_.write("t.csv", "frame,lat_deg,lon_deg\nb.jpg,99,120.5\n"), frames), UsageError);
  EXPECT_THROW(read_truth(folder_.write("t.csv", "frame,lat_deg,lon_deg\nb.jpg,1,1\nb.jpg,1,1\n"), frames), UsageError);
}

}  // namespace
}  // namespace nadir
