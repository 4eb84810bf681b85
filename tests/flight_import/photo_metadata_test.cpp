// What photos say: judged by GDAL's own reader of EXIF, and against cameras on gimbals worked out by hand.
#include "flight_import/photo_metadata.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "flight_import/camera_draft.hpp"
#include "flight_import/sample_photos.hpp"
#include "geodesy/angles.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"
#include "support/tiff_writer.hpp"

namespace nadir {
namespace {

using test::dji_xmp;
using test::SamplePhoto;

PhotoFacts facts_of(const SamplePhoto& photo) {
  return parse_photo_metadata(test::exif_of(photo), as_bytes(photo.xmp));
}

constexpr double kTaken_s = 1'782'232'319;  // 2026-06-23 16:31:59

TEST(PhotoMetadata, ReadsWhatADjiCameraWrites) {
  const test::TemporaryFolder folder;
  SamplePhoto photo;
  photo.gps = LonLat{-91.9945599, 46.8426071};
  photo.xmp = dji_xmp(39.8, 45, -89.9);
  test::write_photo(folder / "DJI_0018.JPG", photo);
  const PhotoFacts facts = read_photo_facts(folder / "DJI_0018.JPG");
  EXPECT_EQ(facts.problem, "");
  EXPECT_EQ(facts.size.width, 64);
  EXPECT_EQ(facts.camera_s, kTaken_s);
  EXPECT_EQ(facts.clock_step_s, 1);
  EXPECT_EQ(facts.zone_s, std::nullopt);
  EXPECT_EQ(facts.make, "DJI");
  EXPECT_EQ(facts.model, "FC300S");
  EXPECT_NEAR(*facts.focal_mm, 3.61, 1e-9);
  EXPECT_EQ(facts.focal_35mm, 20);
  EXPECT_NEAR(*facts.relative_altitude_m, 39.8, 1e-9);
  EXPECT_NEAR(*facts.absolute_altitude_m, 198.3, 1e-9);
  EXPECT_NEAR(facts.gps->lon_deg, -91.9945599, 1e-7);
  EXPECT_NEAR(facts.gps->lat_deg, 46.8426071, 1e-7);
  ASSERT_TRUE(facts.gimbal);
  EXPECT_NEAR(degrees(facts.gimbal->pitch_rad), -89.9, 1e-9);
  // GDAL reads the same from the same file.
  const test::ProcessResult gdal = test::run_process({"gdalinfo", (folder / "DJI_0018.JPG").string()});
  EXPECT_THAT(gdal.out, ::testing::HasSubstr("EXIF_DateTimeOriginal=2026:06:23 16:31:59"));
  EXPECT_THAT(gdal.out, ::testing::HasSubstr("EXIF_FocalLength=(3.61)"));
  EXPECT_THAT(gdal.out, ::testing::HasSubstr("EXIF_GPSLongitudeRef=W"));
  EXPECT_THAT(gdal.out, ::testing::HasSubstr("EXIF_Model=FC300S"));
}

TEST(PhotoMetadata, TimesHaveFractionsZonesAndUtc) {
  SamplePhoto photo{.subsec = "250", .zone = "-03:30", .gps_date = "2026:06:23", .gps_time = "20 1 58"};
  const PhotoFacts facts = facts_of(photo);
  EXPECT_NEAR(*facts.camera_s, kTaken_s + 0.25, 1e-6);
  EXPECT_DOUBLE_EQ(facts.clock_step_s, 0.001);
  EXPECT_EQ(facts.zone_s, -3.5 * 3600);
  EXPECT_EQ(facts.utc_s, kTaken_s + 3.5 * 3600 - 1);
  photo.xmp = dji_xmp(50, 0, -90, 0, "drone-dji:UTCAtExposure=\"2026-06-23T20:01:59.125000\"");
  EXPECT_EQ(facts_of(photo).utc_s, kTaken_s + 3.5 * 3600 - 1);  // another form: GPS counts
  photo.xmp = dji_xmp(50, 0, -90, 0, "drone-dji:UTCAtExposure=\"2026:06:23 20:01:59.125000\"");
  EXPECT_EQ(facts_of(photo).utc_s, kTaken_s + 3.5 * 3600 + 0.125);
}

TEST(PhotoMetadata, ImpossibleValuesAreUnknown) {
  SamplePhoto photo{.taken = "0000:00:00 00:00:00", .focal_mm = 0, .focal_35mm = 0};
  photo.gps = LonLat{0, 0};
  photo.xmp = dji_xmp(1e9, 720, -89.9);
  const PhotoFacts facts = facts_of(photo);
  EXPECT_EQ(facts.camera_s, std::nullopt);
  EXPECT_EQ(facts.focal_mm, std::nullopt);
  EXPECT_EQ(facts.gps, std::nullopt);
  EXPECT_EQ(facts.relative_altitude_m, std::nullopt);
  EXPECT_EQ(facts.gimbal, std::nullopt);
  EXPECT_EQ(facts_of({.taken = "2026:13:45 16:31:59"}).camera_s, std::nullopt);
  EXPECT_EQ(facts_of({.taken = "1970:01:01 00:00:00"}).camera_s, std::nullopt);  // never set
}

// Worked out by hand: at -90° of pitch the top of the image is where the gimbal's yaw points.
TEST(PhotoMetadata, GimbalAnglesBecomeThoseOfACameraThatLooksDown) {
  const auto nadir = [](double yaw_deg, double pitch_deg, double roll_deg) {
    return nadir_attitude_from_gimbal({radians(yaw_deg), radians(pitch_deg), radians(roll_deg)});
  };
  for (const double yaw_deg : {0.0, 45.0, -170.0}) {
    const Attitude down = nadir(yaw_deg, -90, 0);
    EXPECT_NEAR(degrees(wrap_pi(down.heading_rad - radians(yaw_deg))), 0, 1e-6);
    EXPECT_NEAR(down.pitch_rad, 0, 1e-9);
    EXPECT_NEAR(down.roll_rad, 0, 1e-9);
  }
  const Attitude ahead = nadir(45, -80, 0);  // looks 10° ahead of nadir
  EXPECT_NEAR(degrees(ahead.heading_rad), 45, 1e-6);
  EXPECT_NEAR(degrees(ahead.pitch_rad), 10, 1e-6);
  // At nadir a roll of the gimbal turns the image about the optical axis, as a yaw does.
  EXPECT_NEAR(degrees(nadir(45, -90, 10).heading_rad), 55, 1e-6);
  // The optical axis, from the definition of the angles: forward (cos ψ cos θ, sin ψ cos θ, -sin θ) in north, east,
  // down.
  for (const double roll_deg : {0.0, 20.0}) {
    const double yaw = radians(30), pitch = radians(-70);
    const Eigen::Vector3d axis = enu_from_camera(nadir(30, -70, roll_deg)).col(2);
    EXPECT_NEAR(axis.x(), std::sin(yaw) * std::cos(pitch), 1e-9);
    EXPECT_NEAR(axis.y(), std::cos(yaw) * std::cos(pitch), 1e-9);
    EXPECT_NEAR(axis.z(), std::sin(pitch), 1e-9);
  }
}

TEST(PhotoMetadata, TiffHasItsExifToo) {
  const test::TemporaryFolder folder;
  test::write_tiff(folder / "a.tif", cv::Mat(20, 30, CV_8UC3, cv::Scalar(1, 2, 3)));
  {
    TIFF* tiff = TIFFOpen((folder / "a.tif").c_str(), "r+");
    TIFFSetField(tiff, TIFFTAG_MAKE, "Parrot");
    TIFFSetField(tiff, TIFFTAG_MODEL, "Sequoia");
    TIFFSetField(tiff, TIFFTAG_DATETIME, "2026:06:23 16:31:59");
    const std::string xmp =
        R"(<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">)"
        R"(<rdf:Description xmlns:Camera="http://pix4d.com/camera/1.0/" Camera:Yaw="91.5" Camera:Pitch="2.5" )"
        R"(Camera:Roll="-1.25"/></rdf:RDF></x:xmpmeta>)";
    TIFFSetField(tiff, TIFFTAG_XMLPACKET, static_cast<std::uint32_t>(xmp.size()), xmp.data());
    TIFFRewriteDirectory(tiff);
    TIFFClose(tiff);
  }
  const PhotoFacts facts = read_photo_facts(folder / "a.tif");
  EXPECT_EQ(facts.size.height, 20);
  EXPECT_EQ(facts.model, "Sequoia");
  EXPECT_EQ(facts.camera_s, kTaken_s);
  ASSERT_TRUE(facts.body);
  EXPECT_TRUE(facts.body_is_camera);
  EXPECT_NEAR(degrees(facts.body->heading_rad), 91.5, 1e-9);
  EXPECT_NEAR(degrees(facts.body->roll_rad), -1.25, 1e-9);
}

TEST(PhotoMetadata, TruncatedFilesAreNeverMoreThanAnError) {
  const test::TemporaryFolder folder;
  SamplePhoto photo;
  photo.gps = LonLat{8, 47};
  photo.xmp = dji_xmp(39.8, 45, -89.9);
  const Bytes whole = test::jpeg_with(cv::Mat(48, 64, CV_8UC3, cv::Scalar(90, 120, 60)), photo);
  std::size_t read = 0;
  for (std::size_t size = 0; size < whole.size(); size += 100) {
    const auto path = folder.write("cut.jpg", as_text(ByteView(whole).first(size)));
    try {
      read_photo_facts(path);
      ++read;
    } catch (const Error&) {
    }
  }
  EXPECT_GT(read, 0U);  // cut in its pixels, a photo still says what it says
  const Bytes exif = test::exif_of(photo);
  for (std::size_t size = 0; size < exif.size(); ++size) {
    parse_photo_metadata(ByteView(exif).first(size), as_bytes(photo.xmp).first(size % photo.xmp.size()));
  }
}

// Counts and offsets of two thousand million in every field, in turn.
TEST(PhotoMetadata, LengthsOfGigabytesAreRefused) {
  SamplePhoto photo;
  photo.gps = LonLat{8, 47};
  const Bytes exif = test::exif_of(photo);
  for (std::size_t at = 8; at + 4 <= exif.size(); at += 2) {
    Bytes hostile = exif;
    for (std::size_t i = 0; i < 3; ++i) hostile[at + i] = 0xFF;
    hostile[at + 3] = 0x7F;
    parse_photo_metadata(hostile, {});
  }
  EXPECT_TRUE(facts_of(photo).gps);
}

TEST(PhotoMetadata, DamagedXmpIsReportedAndExifCounts) {
  SamplePhoto photo;
  photo.xmp = "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF";
  const PhotoFacts facts = facts_of(photo);
  EXPECT_NE(facts.problem, "");
  EXPECT_EQ(facts.camera_s, kTaken_s);
}

TEST(CameraDraft, FocalLengthInTheOrderOfTrust) {
  PhotoFacts photo = facts_of({});
  photo.size = {4000, 2250};
  const auto focal = [&](const StatedLens& stated = {}) { return draft_camera(photo, stated)->camera.fx; };
  EXPECT_NEAR(focal(), 3.61 / 6.17 * 4000, 1e-6);  // of the table
  EXPECT_NEAR(focal({.focal_mm = 5, .sensor_width_mm = 10}), 2000, 1e-9);
  EXPECT_NEAR(focal({.focal_px = 1234}), 1234, 1e-9);
  photo.model = "Unheard of";
  EXPECT_NEAR(focal(), 20 / 43.2666 * std::hypot(4000, 2250), 0.1);  // for 35 mm film
  photo.sensor_px_per_mm = 640;
  EXPECT_NEAR(focal(), 3.61 * 640, 1e-6);
  photo.calibrated_focal_px = 2300;
  EXPECT_NEAR(focal(), 2300, 1e-9);
  photo = {};
  photo.size = {4000, 2250};
  EXPECT_FALSE(draft_camera(photo, {}));
  photo.focal_mm = 3.61;
  EXPECT_FALSE(draft_camera(photo, {}));
  EXPECT_NEAR(focal({.sensor_width_mm = 6.17}), 3.61 / 6.17 * 4000, 1e-6);
}

TEST(CameraDraft, MakersCalibrationWithDistortion) {
  const test::TemporaryFolder folder;
  SamplePhoto photo{.model = "M3E"};
  photo.xmp = dji_xmp(100, 0, -90, 0,
                      "drone-dji:DewarpData=\"2022-06-08;470.5,471.5,3.5,-2.25,-0.11,0.015,-0.0001,0.0001,-0.02\" "
                      "drone-dji:DewarpFlag=\"0\"");
  test::write_photo(folder / "a.jpg", photo, 640, 480);
  const PhotoFacts facts = read_photo_facts(folder / "a.jpg");
  ASSERT_TRUE(facts.calibration);
  const auto draft = draft_camera(facts, {});
  EXPECT_DOUBLE_EQ(draft->camera.fx, 470.5);
  EXPECT_DOUBLE_EQ(draft->camera.fy, 471.5);
  EXPECT_DOUBLE_EQ(draft->camera.cx, 319.5 + 3.5);
  EXPECT_DOUBLE_EQ(draft->camera.cy, 239.5 - 2.25);
  EXPECT_DOUBLE_EQ(draft->camera.distortion[0], -0.11);
  EXPECT_DOUBLE_EQ(draft->camera.distortion[4], -0.02);
  const auto path = folder.write("camera.yaml", draft_yaml(*draft, {}, "of a test"));
  EXPECT_NEAR(read_camera_file(path).camera.distortion[1], 0.015, 1e-12);
}

TEST(CameraDraft, DisagreementWith35mmIsReported) {
  PhotoFacts photo = facts_of({});
  photo.size = {4000, 2250};
  EXPECT_FALSE(draft_camera(photo, {})->disagreement);
  EXPECT_NEAR(*draft_camera(photo, {.focal_px = 1000})->disagreement, 2.12, 0.01);
}

TEST(CameraDraft, NamesWithAndWithoutTheMaker) {
  EXPECT_EQ(known_sensor_width_mm("SONY", "ILCE-6000"), 23.5);
  EXPECT_EQ(known_sensor_width_mm("Canon", "canon powershot s110"), 7.44);
  EXPECT_EQ(known_sensor_width_mm("Canon", "PowerShot S110"), 7.44);
  EXPECT_EQ(known_sensor_width_mm("DJI", "FC9999"), std::nullopt);
  EXPECT_EQ(known_sensor_width_mm("", ""), std::nullopt);
}

}  // namespace
}  // namespace nadir
