// Imports from end to end: what people have goes in, and what `nadir replay` reads comes out.
#include "flight_import/flight_import.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/csv.hpp"
#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "base/progress.hpp"
#include "base/time.hpp"
#include "flight_import/photo_set.hpp"
#include "flight_import/sample_logs.hpp"
#include "flight_import/sample_photos.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "recorder/sample_records.hpp"
#include "replay/flight_folder.hpp"
#include "replay/recorded_flight.hpp"
#include "support/temporary_folder.hpp"
#include "support/tiff_writer.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::dji_xmp;
using test::SampleFlight;
using test::SamplePhoto;

std::string exif_time(double unix_s) {
  std::string text = to_rfc3339(UtcTime{static_cast<std::int64_t>(std::floor(unix_s))});  // 2026-06-23T16:31:59Z
  text[4] = text[7] = ':';
  text[10] = ' ';
  return text.substr(0, 19);
}

std::string fraction(double unix_s) {
  return fmt::format("{:02}", static_cast<int>(std::floor((unix_s - std::floor(unix_s)) * 100)));
}

class FlightImport : public ::testing::Test {
 protected:
  FlightImport() { fs::create_directory(photos()); }
  fs::path photos() const { return folder_ / "photos"; }
  fs::path out() const { return folder_ / "flight"; }

  ImportResult import(ImportRequest request) {
    fs::remove_all(out());
    if (request.photos.empty() && !request.recording) request.photos = {photos()};
    return import_flight(request, out(), progress_);
  }
  Flight imported() { return read_flight({out() / "frames", out() / "telemetry.csv", out() / "camera.yaml"}); }
  std::string error_of(ImportRequest request) {
    try {
      import(std::move(request));
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }
  static const Finding* finding(const ImportResult& result, std::string_view code) {
    for (const Finding& one : result.findings.items()) {
      if (one.code == code) return &one;
    }
    return nullptr;
  }

  // Photos of the sample flight at these times since boot, by a camera whose clock is ahead of UTC.
  void photograph(const std::vector<double>& times_s, double camera_ahead_s, bool fractions = true) {
    for (std::size_t i = 0; i < times_s.size(); ++i) {
      const double camera_s = times_s[i] + flight_.unix_from_boot_s + camera_ahead_s;
      SamplePhoto photo{.taken = exif_time(camera_s), .subsec = fractions ? fraction(camera_s) : ""};
      test::write_photo(photos() / fmt::format("IMG_{:04}.JPG", i), photo);
    }
  }

  test::TemporaryFolder folder_;
  NoProgress progress_;
  SampleFlight flight_;
  const std::vector<double> triggers_{110.05, 113.42, 121.9, 126.3, 133.8, 140.1, 150.25, 171.6, 180.2, 203.3};
};

TEST_F(FlightImport, DjiPhotosAlone) {
  for (int i = 0; i < 3; ++i) {
    SamplePhoto photo{.taken = fmt::format("2026:06:23 16:3{}:0{}", i, 3 * i)};
    photo.gps = LonLat{8.5 + 0.001 * i, 47.4};
    photo.xmp = dji_xmp(80 + i, 45 + 10 * i, -88);
    test::write_photo(photos() / fmt::format("DJI_000{}.JPG", i), photo);
  }
  const Sha256 before = sha256_file(photos() / "DJI_0001.JPG");
  ImportRequest request;
  request.truth = true;
  const ImportResult result = import(request);
  ASSERT_FALSE(result.findings.has_errors());
  const Flight flight = imported();
  ASSERT_EQ(flight.frames.size(), 3U);
  EXPECT_EQ(flight.frames[1].frame, "DJI_0001.JPG");
  EXPECT_DOUBLE_EQ(*flight.frames[1].agl_m, 81);
  EXPECT_NEAR(degrees(*flight.frames[1].heading_rad), 55, 1e-3);
  EXPECT_NEAR(degrees(*flight.frames[1].pitch_rad), 2, 1e-3);
  EXPECT_NEAR(flight.frames[1].time_s - flight.frames[0].time_s, 63, 1e-6);
  EXPECT_NEAR(flight.camera.camera.fx, 3.61 / 6.17 * 64, 0.01);
  EXPECT_FALSE(flight.frames[1].gps_position);  // GPS is truth, not telemetry
  const CsvTable truth = CsvTable::read(out() / "truth.csv");
  ASSERT_EQ(truth.rows(), 3U);
  EXPECT_NEAR(truth.required_number(2, truth.required_column("lon_deg")), 8.502, 1e-6);
  // Assumptions are stated.
  EXPECT_TRUE(finding(result, "import.height_flat"));
  EXPECT_TRUE(finding(result, "import.zone"));
  EXPECT_FALSE(finding(result, "import.mount"));  // the gimbal says it
  EXPECT_NEAR(result.start->lon_deg, 8.5, 1e-6);
  // Frames are links, and the photos are as they were.
  EXPECT_TRUE(fs::is_symlink(out() / "frames" / "DJI_0001.JPG"));
  EXPECT_EQ(sha256_file(photos() / "DJI_0001.JPG"), before);
  const auto summary = nlohmann::json::parse(read_text_file(out() / "import.json"));
  EXPECT_EQ(summary["schema"], "nadir.flight-import/1");
  EXPECT_EQ(summary["frames"], 3);
  EXPECT_FALSE(summary["assumed"].empty());
}

TEST_F(FlightImport, WithoutTruthNoPositionIsWritten) {
  SamplePhoto photo;
  photo.gps = LonLat{8.5, 47.4};
  photo.xmp = dji_xmp(80, 45, -90);
  test::write_photo(photos() / "a.jpg", photo);
  const ImportResult result = import({});
  EXPECT_FALSE(fs::exists(out() / "truth.csv"));
  EXPECT_FALSE(result.start);
  for (const char* file : {"telemetry.csv", "import.json", "camera.yaml"}) {
    EXPECT_THAT(read_text_file(out() / file), ::testing::Not(::testing::HasSubstr("47.4"))) << file;
  }
}

TEST_F(FlightImport, CopiesAreFiles) {
  SamplePhoto photo;
  photo.xmp = dji_xmp(80, 45, -90);
  test::write_photo(photos() / "a.jpg", photo);
  ImportRequest request;
  request.transfer = FrameTransfer::copy;
  import(request);
  EXPECT_FALSE(fs::is_symlink(out() / "frames" / "a.jpg"));
  EXPECT_EQ(sha256_file(out() / "frames" / "a.jpg"), sha256_file(photos() / "a.jpg"));
}

struct LogKind {
  const char* file;
  Bytes (*bytes)(const SampleFlight&, const std::vector<double>&);
};
Bytes tlog_of(const SampleFlight& flight, const std::vector<double>& triggers_s) {
  return test::sample_tlog(flight, triggers_s);
}
const LogKind kLogs[] = {{"00000042.BIN", test::sample_dataflash}, {"log.ulg", test::sample_ulog}, {"a.tlog", tlog_of}};

TEST_F(FlightImport, PhotosWithEachLog) {
  constexpr double kAhead_s = 7200 + 3.7;  // an hour's zone and a clock that is off
  photograph(triggers_, kAhead_s);
  for (const LogKind& kind : kLogs) {
    SCOPED_TRACE(kind.file);
    ImportRequest request;
    request.log = folder_.write(kind.file, as_text(kind.bytes(flight_, triggers_)));
    request.truth = true;
    const ImportResult result = import(request);
    ASSERT_FALSE(result.findings.has_errors());
    ASSERT_TRUE(result.clock_offset_s);
    EXPECT_NEAR(*result.clock_offset_s, -flight_.unix_from_boot_s - kAhead_s, 0.02);
    EXPECT_LT(*result.clock_offset_sigma_s, 0.1);
    const Flight flight = imported();
    ASSERT_EQ(flight.frames.size(), triggers_.size());
    for (std::size_t i = 0; i < triggers_.size(); ++i) {
      const Telemetry& frame = flight.frames[i];
      EXPECT_NEAR(frame.time_s, triggers_[i] + flight_.unix_from_boot_s, 0.005);
      EXPECT_NEAR(*frame.agl_m, flight_.height_at(triggers_[i]), 0.02);
      EXPECT_NEAR(degrees(wrap_pi(*frame.heading_rad - flight_.attitude_at(triggers_[i]).heading_rad)), 0, 1);
      EXPECT_NEAR(degrees(*frame.pitch_rad), degrees(flight_.attitude_at(triggers_[i]).pitch_rad), 0.05);
    }
    const CsvTable truth = CsvTable::read(out() / "truth.csv");
    ASSERT_EQ(truth.rows(), triggers_.size());
    EXPECT_NEAR(truth.required_number(3, 1), flight_.lat_at(triggers_[3]), 2e-5);
    EXPECT_TRUE(finding(result, "import.mount"));
    EXPECT_TRUE(finding(result, "import.height_flat"));
  }
}

TEST_F(FlightImport, TheMountTurnsTheLogsAttitudeIntoTheCameras) {
  photograph(triggers_, 0);
  ImportRequest request;
  request.log = folder_.write("a.BIN", as_text(test::sample_dataflash(flight_, triggers_)));
  request.mount = {radians(90), 0, 0};
  const ImportResult result = import(request);
  const Flight flight = imported();
  const Attitude expected = camera_attitude(flight_.attitude_at(triggers_[4]), request.mount);
  EXPECT_NEAR(degrees(wrap_pi(*flight.frames[4].heading_rad - expected.heading_rad)), 0, 1);
  EXPECT_NEAR(degrees(*flight.frames[4].pitch_rad), degrees(expected.pitch_rad), 0.05);
  EXPECT_FALSE(finding(result, "import.mount"));
}

TEST_F(FlightImport, InertialSamplesOfTheLogAreThoseOfTheCamera) {
  photograph(triggers_, 0);
  flight_.inertial_hz = 100;
  for (const double mounted_deg : {0.0, 90.0}) {
    for (const LogKind& kind : {kLogs[0], kLogs[1]}) {
      SCOPED_TRACE(fmt::format("{}, {}°", kind.file, mounted_deg));
      ImportRequest request;
      request.log = folder_.write(kind.file, as_text(kind.bytes(flight_, triggers_)));
      request.mount = {radians(mounted_deg), 0, 0};
      ASSERT_FALSE(import(request).findings.has_errors());
      const Flight flight = imported();
      const double time_s = triggers_[4];
      const std::vector<InertialSample>& samples = flight.frames[4].inertial;
      EXPECT_NEAR(static_cast<double>(samples.size()), 100 * (time_s - triggers_[3]), 3);
      EXPECT_NEAR(samples.back().time_s, flight.frames[4].time_s, 0.011);
      EXPECT_NEAR(samples.back().force_mps2.z(), -9.8, 1e-5);
      // Of a camera whose image-up is to the right: what was forward is to its left.
      const Eigen::Vector3d aircraft = flight_.rate_at(time_s);
      const Eigen::Vector3d expected =
          mounted_deg == 0 ? aircraft : Eigen::Vector3d(aircraft.y(), -aircraft.x(), aircraft.z());
      EXPECT_LT((*flight.frames[4].rate_rad_s - expected).norm(), radians(0.5));
      EXPECT_LT((samples.back().rate_rad_s - expected).norm(), radians(0.5));
    }
  }
}

TEST_F(FlightImport, FewInertialSamplesAreLeftOut) {
  photograph(triggers_, 0);
  flight_.inertial_hz = 10;
  ImportRequest request;
  request.log = folder_.write("a.BIN", as_text(test::sample_dataflash(flight_, triggers_)));
  const ImportResult result = import(request);
  EXPECT_TRUE(finding(result, "import.inertial"));
  EXPECT_FALSE(fs::exists(out() / "imu.csv"));
  EXPECT_TRUE(imported().frames[3].inertial.empty());
}

TEST_F(FlightImport, TheStatedClockOffsetWins) {
  photograph(triggers_, 0);
  ImportRequest request;
  request.log = folder_.write("a.BIN", as_text(test::sample_dataflash(flight_, triggers_)));
  request.clock_offset_s = -flight_.unix_from_boot_s + 10;
  const ImportResult result = import(request);
  EXPECT_EQ(*result.clock_offset_s, *request.clock_offset_s);
  EXPECT_NEAR(imported().frames[0].time_s, triggers_[0] + flight_.unix_from_boot_s + 10, 0.02);
}

TEST_F(FlightImport, UtcOfBothPlacesPhotosWithoutTriggers) {
  for (std::size_t i = 0; i < triggers_.size(); ++i) {
    const double utc_s = triggers_[i] + flight_.unix_from_boot_s;
    SamplePhoto photo{.taken = exif_time(utc_s + 7200), .subsec = fraction(utc_s)};
    photo.gps_date = exif_time(utc_s).substr(0, 10);
    const std::string clock = exif_time(utc_s).substr(11);
    photo.gps_time = clock.substr(0, 2) + " " + clock.substr(3, 2) + " " + clock.substr(6, 2);
    test::write_photo(photos() / fmt::format("IMG_{:04}.JPG", i), photo);
  }
  ImportRequest request;
  request.log = folder_.write("a.ulg", as_text(test::sample_ulog(flight_, {})));
  const ImportResult result = import(request);
  ASSERT_TRUE(result.clock_offset_s);
  EXPECT_NEAR(*result.clock_offset_s, -flight_.unix_from_boot_s - 7200, 1);
  EXPECT_THAT(result.clock_offset_from, ::testing::HasSubstr("UTC"));
  EXPECT_EQ(imported().frames.size(), triggers_.size());
}

TEST_F(FlightImport, TurnsInThePicturesPlaceThemWithoutTriggersAndUtc) {
  const test::SampleGround ground;
  constexpr double kAhead_s = 12'345;
  int number = 0;
  for (double t = 104; t < 200; t += 2, ++number) {
    const double camera_s = t + flight_.unix_from_boot_s + kAhead_s;
    const SamplePhoto photo{.taken = exif_time(camera_s), .subsec = fraction(camera_s)};
    const cv::Mat picture =
        ground.picture(6 * number - 150, 4 * number - 100, degrees(flight_.attitude_at(t).heading_rad), {640, 480});
    write_file_atomic(photos() / fmt::format("IMG_{:04}.JPG", number), ByteView(test::jpeg_with(picture, photo)));
  }
  ImportRequest request;
  request.log = folder_.write("a.BIN", as_text(test::sample_dataflash(flight_, {})));
  const ImportResult result = import(request);
  ASSERT_FALSE(result.findings.has_errors());
  EXPECT_NEAR(*result.clock_offset_s, -flight_.unix_from_boot_s - kAhead_s, 0.3);
  EXPECT_LT(*result.clock_offset_sigma_s, 0.3);
  EXPECT_THAT(result.clock_offset_from, ::testing::HasSubstr("turns"));
}

TEST_F(FlightImport, AnOffsetThatNothingDeterminesIsAskedFor) {
  photograph({120, 122, 124, 126, 128}, 7200);
  ImportRequest request;
  request.log = folder_.write("a.BIN", as_text(test::sample_dataflash(flight_, {})));
  const ImportResult result = import(request);
  const Finding* asked = finding(result, "import.clock_offset");
  ASSERT_TRUE(asked);
  EXPECT_EQ(asked->severity, Severity::error);
  EXPECT_THAT(asked->fix, ::testing::HasSubstr("--clock-offset-s"));
  EXPECT_FALSE(fs::exists(out()));
}

TEST_F(FlightImport, PhotosWithoutTimesTakeTheTriggersOneForOne) {
  for (std::size_t i = 0; i < triggers_.size(); ++i) {
    test::write_photo(photos() / fmt::format("scan{}.jpg", i + 1), {.taken = ""});  // scan10 is the last
  }
  ImportRequest request;
  request.log = folder_.write("a.BIN", as_text(test::sample_dataflash(flight_, triggers_)));
  const ImportResult result = import(request);
  ASSERT_FALSE(result.findings.has_errors());
  EXPECT_TRUE(finding(result, "import.triggers"));
  const Flight flight = imported();
  EXPECT_EQ(flight.frames.back().frame, "scan10.jpg");
  EXPECT_NEAR(flight.frames.back().time_s, triggers_.back() + flight_.unix_from_boot_s, 0.005);
  fs::remove(photos() / "scan3.jpg");
  const ImportResult fewer = import(request);
  EXPECT_TRUE(finding(fewer, "import.clock_offset"));
  EXPECT_TRUE(fewer.findings.has_errors());
}

TEST_F(FlightImport, PhotosStartAndHeight) {
  for (int i = 0; i < 4; ++i) {
    write_file_atomic(photos() / fmt::format("{}.jpg", i),
                      ByteView(encode_image(cv::Mat(48, 64, CV_8UC3, cv::Scalar(9, 90, 60)), ImageFormat::jpeg)));
  }
  const ImportResult lacking = import({});
  EXPECT_TRUE(lacking.findings.has_errors());
  EXPECT_THAT(finding(lacking, "import.time")->fix, ::testing::HasSubstr("--interval-s"));
  EXPECT_THAT(finding(lacking, "import.focal_length")->fix, ::testing::HasSubstr("--focal-px"));
  EXPECT_FALSE(fs::exists(out()));
  ImportRequest request;
  request.interval_s = 2.5;
  request.lens.focal_px = 50;
  EXPECT_THAT(finding(import(request), "import.height")->fix, ::testing::HasSubstr("--agl-m"));
  request.agl_m = 120;
  request.start = LonLat{8.5, 47.4};
  const ImportResult result = import(request);
  ASSERT_FALSE(result.findings.has_errors());
  EXPECT_EQ(result.start, request.start);
  EXPECT_TRUE(finding(result, "import.heading"));
  const Flight flight = imported();
  EXPECT_DOUBLE_EQ(flight.frames[3].time_s, 7.5);
  EXPECT_DOUBLE_EQ(*flight.frames[3].agl_m, 120);
  EXPECT_FALSE(flight.frames[3].heading_rad);
  EXPECT_DOUBLE_EQ(flight.camera.camera.fx, 50);
}

TEST_F(FlightImport, SeaLevelHeightsNeedTheGround) {
  SamplePhoto photo;
  photo.gps = LonLat{8.5, 47.4};
  photo.gps_alt_m = 640;
  test::write_photo(photos() / "a.jpg", photo);
  EXPECT_THAT(finding(import({}), "import.height")->found, ::testing::HasSubstr("above sea level"));
  ImportRequest request;
  request.ground_m = 500;
  const ImportResult result = import(request);
  EXPECT_DOUBLE_EQ(*imported().frames[0].agl_m, 140);
  EXPECT_TRUE(finding(result, "import.height_datum"));
  request.ground_m.reset();
  request.ground_height_m = [](LonLat place) { return std::optional(place.lat_deg * 10); };
  import(request);
  EXPECT_NEAR(*imported().frames[0].agl_m, 640 - 474, 1e-6);
}

TEST_F(FlightImport, TerrainTurnsHeightAboveHomeIntoHeightAboveGround) {
  photograph(triggers_, 0);
  ImportRequest request;
  request.log = folder_.write("a.BIN", as_text(test::sample_dataflash(flight_, triggers_)));
  request.ground_height_m = [](LonLat place) { return std::optional(400 + (place.lon_deg - 8.5) * 1000); };
  const ImportResult result = import(request);
  EXPECT_FALSE(finding(result, "import.height_flat"));
  EXPECT_TRUE(finding(result, "import.terrain_lookup"));
  const double expected = flight_.height_at(triggers_[8]) - (flight_.lon_at(triggers_[8]) - 8.5) * 1000;
  EXPECT_NEAR(*imported().frames[8].agl_m, expected, 0.1);
}

TEST_F(FlightImport, BurstsOfOneSecondAreSpreadInTheOrderOfTheirNames) {
  for (int i = 8; i < 12; ++i) {
    SamplePhoto photo;
    photo.xmp = dji_xmp(80, 45, -90);
    test::write_photo(photos() / fmt::format("img{}.jpg", i), photo);
  }
  const ImportResult result = import({});
  EXPECT_TRUE(finding(result, "import.burst"));
  const Flight flight = imported();
  ASSERT_EQ(flight.frames.size(), 4U);
  EXPECT_EQ(flight.frames[0].frame, "img8.jpg");
  EXPECT_EQ(flight.frames[3].frame, "img11.jpg");
  for (int i = 1; i < 4; ++i) {
    EXPECT_NEAR(flight.frames[static_cast<std::size_t>(i)].time_s - flight.frames[0].time_s, 0.25 * i, 1e-6);
  }
}

TEST_F(FlightImport, NamesThatRepeatInFoldersAreToldApart) {
  for (const char* sub : {"100MEDIA", "101MEDIA"}) {
    fs::create_directory(photos() / sub);
    SamplePhoto photo{.taken = sub[2] == '0' ? "2026:06:23 16:31:59" : "2026:06:23 16:35:00"};
    photo.xmp = dji_xmp(80, 45, -90);
    test::write_photo(photos() / sub / "DJI_0001.JPG", photo);
  }
  const ImportResult result = import({});
  EXPECT_TRUE(finding(result, "import.names"));
  const Flight flight = imported();
  ASSERT_EQ(flight.frames.size(), 2U);
  EXPECT_EQ(flight.frames[0].frame, "100MEDIA_DJI_0001.JPG");
  EXPECT_EQ(flight.frames[1].frame, "101MEDIA_DJI_0001.JPG");
}

TEST_F(FlightImport, TimeDecidesOverNamesAndSaysSo) {
  int minute = 30;
  for (const char* name : {"DJI_0999.JPG", "DJI_0001.JPG", "DJI_0002.JPG"}) {  // the counter wrapped
    SamplePhoto photo{.taken = fmt::format("2026:06:23 16:{}:59", minute++)};
    photo.xmp = dji_xmp(80, 45, -90);
    test::write_photo(photos() / name, photo);
  }
  const ImportResult result = import({});
  EXPECT_TRUE(finding(result, "import.order"));
  EXPECT_EQ(imported().frames[0].frame, "DJI_0999.JPG");
}

TEST_F(FlightImport, OfTwoCamerasOneIsChosen) {
  for (int i = 0; i < 3; ++i) {
    SamplePhoto wide{.taken = fmt::format("2026:06:23 16:31:0{}", i)};
    wide.xmp = dji_xmp(80, 45, -90);
    test::write_photo(photos() / fmt::format("DJI_{}_W.JPG", i), wide);
    SamplePhoto thermal = wide;
    thermal.model = "FC350";
    if (i > 0) test::write_photo(photos() / fmt::format("DJI_{}_T.JPG", i), thermal, 32, 24);
  }
  const ImportResult result = import({});
  EXPECT_THAT(finding(result, "import.other_camera")->found, ::testing::HasSubstr("2 of FC350"));
  EXPECT_EQ(imported().frames.size(), 3U);
  ImportRequest request;
  request.model = "FC350";
  import(request);
  EXPECT_EQ(imported().camera.camera.width, 32);
  request.model = "FC999";
  EXPECT_THAT(error_of(request), ::testing::HasSubstr("FC300S"));
}

TEST_F(FlightImport, ObliqueAndLowPhotosAreLeftOut) {
  const double pitches[] = {-90, -30, -90}, heights[] = {80, 80, 1.2};
  for (int i = 0; i < 3; ++i) {
    SamplePhoto photo{.taken = fmt::format("2026:06:23 16:31:0{}", i)};
    photo.xmp = dji_xmp(heights[i], 45, pitches[i]);
    test::write_photo(photos() / fmt::format("{}.jpg", i), photo);
  }
  const ImportResult result = import({});
  EXPECT_TRUE(finding(result, "import.oblique"));
  EXPECT_TRUE(finding(result, "import.on_ground"));
  EXPECT_EQ(imported().frames.size(), 1U);
}

TEST_F(FlightImport, PhotosOutsideOfTheLogAreLeftOut) {
  std::vector<double> times_s = triggers_;
  times_s.push_back(400);
  photograph(times_s, 0);
  ImportRequest request;
  request.log = folder_.write("a.BIN", as_text(test::sample_dataflash(flight_, triggers_)));
  const ImportResult result = import(request);
  EXPECT_TRUE(finding(result, "import.outside_log"));
  EXPECT_EQ(imported().frames.size(), triggers_.size());
}

TEST_F(FlightImport, TiffFramesAreTaken) {
  test::write_tiff(photos() / "a.tif", cv::Mat(48, 64, CV_8UC3, cv::Scalar(9, 90, 60)));
  ImportRequest request;
  request.interval_s = 1;
  request.agl_m = 100;
  request.lens.focal_px = 60;
  import(request);
  const Flight flight = imported();
  EXPECT_EQ(flight.frames[0].frame, "a.tif");
  EXPECT_EQ(read_flight_image(flight.image_path(0), flight.camera.camera, 1).cols, 64);
}

TEST_F(FlightImport, HeicAndWhatIsNoPhotoAreNamed) {
  EXPECT_THAT(error_of({}), ::testing::HasSubstr("there are no photos"));
  folder_.write("photos/notes.txt", "x");
  folder_.write("photos/IMG_1.HEIC", "x");
  EXPECT_THAT(error_of({}), ::testing::HasSubstr("HEIC is not supported: convert to JPEG"));
  folder_.write("photos/b.jpg", "no image");
  EXPECT_THAT(error_of({}), ::testing::HasSubstr("none of the photos can be read"));
  SamplePhoto photo;
  photo.xmp = dji_xmp(80, 45, -90);
  test::write_photo(photos() / "a.jpg", photo);
  const ImportResult result = import({});
  EXPECT_TRUE(finding(result, "import.heic"));
  EXPECT_TRUE(finding(result, "import.photo_unreadable"));
  EXPECT_EQ(imported().frames.size(), 1U);
}

TEST_F(FlightImport, NamesThatAreNoTextAndLinksThatLeadNowhere) {
  SamplePhoto photo;
  photo.xmp = dji_xmp(80, 45, -90);
  test::write_photo(photos() / "a\xff,\"b\".jpg", photo);
  folder_.write("photos/\xfe.jpg", "no image");
  fs::create_symlink("loop.jpg", photos() / "loop.jpg");
  fs::create_symlink("/nowhere", photos() / "gone.jpg");
  const ImportResult result = import({});
  EXPECT_TRUE(finding(result, "import.photo_unreadable"));
  EXPECT_EQ(imported().frames.at(0).frame, "a?__b_.jpg");
  EXPECT_EQ(nlohmann::json::parse(read_text_file(out() / "import.json"))["frames"], 1);
}

TEST_F(FlightImport, LogsThatAreNoneAndEmptyOnes) {
  photograph(triggers_, 0);
  ImportRequest request;
  request.log = folder_.write("log.txt", "12:00 took off");
  EXPECT_THAT(error_of(request), ::testing::HasSubstr("no log that Nadir reads"));
  request.log = folder_.write("empty.BIN", "");
  EXPECT_THAT(error_of(request), ::testing::HasSubstr("an empty file"));
  request.log = folder_.write("empty.ulg", as_text(test::UlogWriter().bytes));
  EXPECT_THAT(error_of(request), ::testing::HasSubstr("no attitude and no heights"));
  request.log = folder_ / "absent.BIN";
  EXPECT_NE(error_of(request), "");
  EXPECT_FALSE(fs::exists(out()));
}

TEST_F(FlightImport, ExistingOutputIsNeverTouched) {
  photograph(triggers_, 0);
  folder_.write("flight/keep.txt", "mine");
  ImportRequest request;
  request.photos = {photos()};
  EXPECT_THROW(import_flight(request, out(), progress_), Error);
  EXPECT_EQ(read_text_file(out() / "keep.txt"), "mine");
}

TEST_F(FlightImport, CameraOfAnotherSizeIsRefused) {
  SamplePhoto photo;
  photo.xmp = dji_xmp(80, 45, -90);
  test::write_photo(photos() / "a.jpg", photo);
  ImportRequest request;
  request.camera = folder_.write("camera.yaml",
                                 "model: pinhole\nwidth: 640\nheight: 480\nfx: 600\nfy: 600\ncx: 320\ncy: 240\n"
                                 "distortion: []\nuncertainty: {heading_deg: 3, agl_relative: 0.05, tilt_deg: 1}\n");
  EXPECT_TRUE(finding(import(request), "import.camera_size"));
  EXPECT_FALSE(fs::exists(out()));
}

class RecordingImport : public FlightImport {
 protected:
  void record(const std::vector<std::string>& names, bool keep_images) {
    fs::remove_all(folder_ / "recording");
    SessionRecord session = test::sample_session();
    session.camera.camera.width = 64;
    session.camera.camera.height = 48;
    session.camera.camera.cx = 31.5;
    session.camera.camera.cy = 23.5;
    session.camera.camera.distortion = {};
    camera_ = session.camera;
    ReplayRecording recording(folder_ / "recording", session, keep_images);
    for (std::size_t i = 0; i < names.size(); ++i) {
      const fs::path image = photos() / fmt::format("frame_{}.jpg", i);
      test::write_photo(image, {.taken = fmt::format("2026:06:23 16:31:0{}", i)});
      Telemetry telemetry;
      telemetry.frame = names[i];
      telemetry.time_s = 1000 + 2.0 * static_cast<double>(i);
      telemetry.agl_m = 120.5;
      telemetry.heading_rad = radians(10.0 * static_cast<double>(i) - 5);
      telemetry.roll_rad = radians(2);
      if (i > 0) {
        telemetry.intervals.push_back({1, radians(3), Eigen::Vector2d(0.5, -0.25)});
        telemetry.imu_dv_mps = Eigen::Vector2d(1, 2);
        for (int k = 1; k <= 40; ++k) {
          telemetry.inertial.push_back({telemetry.time_s - 2 + 0.05 * k, {0.01, 0.02, 0.03}, {0.1, 0.2, -9.8}});
        }
      }
      telemetry.gps_position = LonLat{8.5, 47.4};
      recording.before(i, telemetry, image);
    }
    recording.close();
  }
  ImportRequest request() const {
    ImportRequest request;
    request.recording = folder_ / "recording";
    return request;
  }
  CameraFile camera_;
};

TEST_F(RecordingImport, FramesTelemetryAndCameraAsTheyWereFlown) {
  record({"frame_0.jpg", "frame_1.jpg", "frame_2.jpg"}, true);
  ImportRequest wanted = request();
  wanted.truth = true;
  const ImportResult result = import(wanted);
  ASSERT_FALSE(result.findings.has_errors());
  const Flight flight = imported();
  ASSERT_EQ(flight.frames.size(), 3U);
  EXPECT_EQ(flight.frames[2].frame, "frame_2.jpg");
  EXPECT_EQ(sha256_file(flight.image_path(2)), sha256_file(photos() / "frame_2.jpg"));
  EXPECT_DOUBLE_EQ(flight.frames[2].time_s, 1004);
  EXPECT_DOUBLE_EQ(*flight.frames[2].agl_m, 120.5);
  EXPECT_NEAR(degrees(*flight.frames[0].heading_rad), 355, 1e-3);
  EXPECT_FALSE(flight.frames[0].pitch_rad);
  EXPECT_FALSE(flight.frames[0].imu_dv_mps);
  EXPECT_NEAR(flight.frames[1].imu_dv_mps->x(), 1.5, 1e-9);  // of both intervals
  EXPECT_NEAR(flight.frames[1].imu_dv_mps->y(), 1.75, 1e-9);
  ASSERT_EQ(flight.frames[2].inertial.size(), 40U);
  EXPECT_NEAR(flight.frames[2].inertial[3].time_s, 1002.2, 1e-6);
  EXPECT_NEAR(flight.frames[2].inertial[3].rate_rad_s.z(), 0.03, 1e-6);
  EXPECT_EQ(flight.camera.camera.fx, camera_.camera.fx);
  EXPECT_NEAR(flight.camera.uncertainty.tilt_rad, camera_.uncertainty.tilt_rad, 1e-12);
  EXPECT_EQ(CsvTable::read(out() / "truth.csv").rows(), 3U);
}

TEST_F(RecordingImport, NamesOfARecordingMayBeAnything) {
  record({"../../../etc/passwd", "a,b\n.jpg", "same", "same"}, true);
  const ImportResult result = import(request());
  EXPECT_TRUE(finding(result, "import.names"));
  const Flight flight = imported();
  ASSERT_EQ(flight.frames.size(), 4U);
  EXPECT_EQ(flight.frames[0].frame, "00000000.jpg");
  EXPECT_EQ(flight.frames[1].frame, "00000001.jpg");
  EXPECT_EQ(flight.frames[2].frame, "same.jpg");
  EXPECT_EQ(flight.frames[3].frame, "00000003_same.jpg");
}

TEST_F(RecordingImport, ImagesMayLieInAFolder) {
  record({"frame_0.jpg", "frame_1.jpg"}, false);
  EXPECT_THAT(error_of(request()), ::testing::HasSubstr("does not hold its images"));
  ImportRequest wanted = request();
  wanted.photos = {photos()};
  import(wanted);
  EXPECT_EQ(imported().frames.size(), 2U);
  EXPECT_TRUE(fs::is_symlink(out() / "frames" / "frame_1.jpg"));
  test::write_photo(photos() / "frame_1.jpg", {.taken = "2026:06:23 17:00:00"});  // another picture
  EXPECT_THAT(error_of(wanted), ::testing::HasSubstr("not the image of the flight"));
}

TEST_F(RecordingImport, TruncatedRecordingsGiveWhatTheyHold) {
  record({"frame_0.jpg", "frame_1.jpg", "frame_2.jpg"}, true);
  for (const auto& entry : fs::directory_iterator(folder_ / "recording")) {
    if (entry.path().extension() == ".mcap") fs::resize_file(entry.path(), fs::file_size(entry.path()) * 2 / 3);
  }
  const std::string error = error_of(request());
  if (error.empty()) {
    EXPECT_LE(imported().frames.size(), 3U);
  }
  EXPECT_EQ(error.empty(), fs::exists(out()));
}

TEST(NaturalOrder, NumbersCountAsNumbers) {
  std::vector<std::string> names{"img10.jpg", "img9.jpg", "img09b.jpg", "a2b10", "a2b9", "Z1", "img1"};
  std::sort(names.begin(), names.end(), [](const auto& a, const auto& b) { return natural_less(a, b); });
  EXPECT_THAT(names, ::testing::ElementsAre("Z1", "a2b9", "a2b10", "img1", "img9.jpg", "img09b.jpg", "img10.jpg"));
  EXPECT_FALSE(natural_less("a", "a"));
}

}  // namespace
}  // namespace nadir
