// Positions written into photos: judged by GDAL's reader of EXIF, which shares no code with exiv2.
#include "flight_import/photo_position.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "flight_import/photo_metadata.hpp"
#include "flight_import/sample_photos.hpp"
#include "imagery/codecs.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using test::SamplePhoto;
using ::testing::HasSubstr;

TEST(PhotoPosition, IsReadBackToMillimetresAndKeepsTheRest) {
  const test::TemporaryFolder folder;
  const auto path = folder / "photo.jpg";
  SamplePhoto photo;
  photo.gps = LonLat{8.5, 47.4};  // what a receiver wrote is replaced
  photo.xmp = test::dji_xmp(39.8, 45, -89.9);
  test::write_photo(path, photo);
  const PhotoFacts before = read_photo_facts(path);
  for (const LonLat place :
       {LonLat{11.2345678, 48.7654321}, LonLat{-83.3057201, -41.0346702}, LonLat{179.9999999, 0}}) {
    write_photo_position(path, {place, 2.5});
    const PhotoFacts facts = read_photo_facts(path);
    ASSERT_TRUE(facts.gps.has_value());
    EXPECT_NEAR(facts.gps->lon_deg, place.lon_deg, 2e-8);
    EXPECT_NEAR(facts.gps->lat_deg, place.lat_deg, 2e-8);
    EXPECT_EQ(facts.camera_s, before.camera_s);
    EXPECT_EQ(facts.model, before.model);
    EXPECT_EQ(facts.absolute_altitude_m, before.absolute_altitude_m);
    EXPECT_EQ(facts.relative_altitude_m, before.relative_altitude_m) << "XMP";
    EXPECT_TRUE(facts.gimbal.has_value());
  }
}

TEST(PhotoPosition, GdalReadsItFromAPhotoWithoutMetadata) {
  const test::TemporaryFolder folder;
  const auto path = folder / "plain.jpg";
  write_file_atomic(path, ByteView(encode_image(cv::Mat(48, 64, CV_8UC3, cv::Scalar(9, 90, 60)), ImageFormat::jpeg)));
  write_photo_position(path, {{-83.3057201, 41.0346702}, 2});
  const auto info = test::run_process({"gdalinfo", path.string()});
  ASSERT_EQ(info.code, 0) << info.err;
  EXPECT_THAT(info.out, HasSubstr("EXIF_GPSLatitudeRef=N"));
  EXPECT_THAT(info.out, HasSubstr("EXIF_GPSLongitudeRef=W"));
  EXPECT_THAT(info.out, HasSubstr("EXIF_GPSLatitude=(41) (2) (4.8127)"));
  EXPECT_THAT(info.out, HasSubstr("EXIF_GPSMapDatum=WGS-84"));
}

TEST(PhotoPosition, TheRadiusHoldsTwoThirds) {
  EXPECT_NEAR(radius_68_m(2), 3.019, 0.001);
  EXPECT_EQ(radius_68_m(0), 0);
}

TEST(PhotoPosition, WhatIsNoPhotoIsNamed) {
  const test::TemporaryFolder folder;
  const auto path = folder.write("text.jpg", "no picture at all");
  try {
    write_photo_position(path, {{1, 2}, 3});
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.text().where, path.string());
  }
  EXPECT_EQ(as_text(read_file(path)), "no picture at all");
}

}  // namespace
}  // namespace nadir
