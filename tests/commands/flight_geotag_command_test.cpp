// nadir flight geotag as a user calls it: copies get positions, originals stay as they are.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/files.hpp"
#include "commands/command_fixture.hpp"
#include "flight_import/photo_metadata.hpp"
#include "imagery/codecs.hpp"

namespace nadir {
namespace {

using ::testing::HasSubstr;

constexpr const char* kHeader =
    "frame,time_s,lat_deg,lon_deg,sigma_m,source,segment,anchor_age_s,anchor_inliers,anchor_ratio,latency_ms,hpl_m\n";

class FlightGeotagCommandTest : public test::CommandTest {
 protected:
  FlightGeotagCommandTest() {
    std::filesystem::create_directory(path("photos"));
    for (const char* name : {"photos/a.jpg", "photos/b.jpg", "photos/c.jpg"}) write_file_atomic(path(name), bytes());
    // As `nadir flight import` makes them.
    std::filesystem::create_directory(path("frames"));
    for (const char* name : {"a.jpg", "b.jpg", "c.jpg"}) {
      std::filesystem::create_symlink(path("photos") + "/" + name, path("frames") + "/" + name);
    }
  }
  static Bytes bytes() { return encode_image(cv::Mat(48, 64, CV_8UC3, cv::Scalar(9, 90, 60)), ImageFormat::jpeg); }
  void estimates(const std::string& rows) { folder_.write("refined.csv", kHeader + rows); }
  int geotag() {
    return run({"flight", "geotag", "--frames", "@frames", "--estimates", "@refined.csv", "--out", "@out"});
  }
};

TEST_F(FlightGeotagCommandTest, CopiesHavePositionsAndOriginalsStay) {
  estimates(
      "a.jpg,10.000,47.40000000,8.50000000,2.000,satellite_anchored,0,0.000,80,0.5000,90.0,\n"
      "b.jpg,12.000,47.40100000,8.50100000,45.000,dead_reckoned,0,2.000,80,0.5000,90.0,\n"
      "c.jpg,14.000,,,,no_fix,0,,,,90.0,\n");
  EXPECT_EQ(geotag(), 0) << err_.str();
  const PhotoFacts facts = read_photo_facts(path("out/a.jpg"));
  ASSERT_TRUE(facts.gps.has_value());
  EXPECT_NEAR(facts.gps->lat_deg, 47.4, 1e-7);
  EXPECT_FALSE(std::filesystem::exists(path("out/b.jpg"))) << "45 m is beyond --max-sigma-m";
  EXPECT_FALSE(std::filesystem::exists(path("out/c.jpg")));
  EXPECT_FALSE(std::filesystem::is_symlink(path("out/a.jpg")));
  EXPECT_EQ(read_file(path("photos/a.jpg")), bytes());
  EXPECT_EQ(as_text(read_file(path("out/positions.csv"))),
            "photo,utc,lat_deg,lon_deg,sigma_m,radius_68_m,source\n"
            "a.jpg,,47.40000000,8.50000000,2.000,3.019,satellite_anchored\n");
}

TEST_F(FlightGeotagCommandTest, WithoutAnyAccuratePositionNothingIsWritten) {
  estimates("a.jpg,10.000,,,,no_fix,0,,,,90.0,\n");
  EXPECT_EQ(geotag(), 1);
  EXPECT_THAT(err_.str(), HasSubstr("nothing was written"));
  EXPECT_FALSE(std::filesystem::exists(path("out")));
}

TEST_F(FlightGeotagCommandTest, NamesThatLeadOutOfTheFolderAreRejected) {
  for (const char* name : {"../photos/a.jpg", "/etc/hostname", ".."}) {
    estimates(std::string(name) + ",10.000,47.4,8.5,2.000,satellite_anchored,0,0.000,80,0.5000,90.0,\n");
    EXPECT_EQ(geotag(), 2) << name;
    EXPECT_FALSE(std::filesystem::exists(path("out")));
  }
  EXPECT_EQ(read_file(path("photos/a.jpg")), bytes());
}

TEST_F(FlightGeotagCommandTest, SaysWhichPhotoIsMissing) {
  estimates("gone.jpg,10.000,47.4,8.5,2.000,satellite_anchored,0,0.000,80,0.5000,90.0,\n");
  EXPECT_EQ(geotag(), 2);
  EXPECT_THAT(err_.str(), HasSubstr("gone.jpg"));
}

}  // namespace
}  // namespace nadir
