// Flights that were stated wrongly, over a small landscape: the cause is named, and nothing else is.
#include "flights/no_fix_diagnosis.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "estimation/localizer_fixture.hpp"
#include "geodesy/angles.hpp"

namespace nadir::test {
namespace {

using ::testing::HasSubstr;

// Eight frames as they were really taken, at 28 m/s, every other one of which is tried: windows grow with the time
// between frames. A test states them wrongly.
struct WronglyStated {
  CameraFile camera = flight_camera();
  LocalFrame frame{kOrigin};
  std::vector<Telemetry> telemetry;
  std::vector<cv::Mat> images;
  StatedFlight flight{.camera = camera,
                      .frame = frame,
                      .tiles = landscape_tiles(),
                      .start = start(),
                      .area = PlaneBox{-220, -220, 220, 220},
                      .ground_msl_m = std::nullopt,
                      .telemetry = {},
                      .read = [this](std::size_t i) { return images.at(i); }};

  WronglyStated() {
    static const std::vector<Moment> moments = nadir::test::flight(8);
    for (const Moment& moment : moments) {
      telemetry.push_back(moment.telemetry);
      telemetry.back().time_s = 10 + 0.9 * static_cast<double>(images.size());
      images.push_back(moment.image);
    }
    flight.telemetry = telemetry;
  }
  WronglyStated(const WronglyStated&) = delete;
  WronglyStated& operator=(const WronglyStated&) = delete;

  // Three frames suffice to find nothing, and a small area.
  void photograph_another_place() {
    static const Landscape elsewhere(77, 220);
    static const std::vector<Moment> moments = nadir::test::flight(3);
    images.resize(3);
    for (std::size_t i = 0; i < images.size(); ++i) {
      images[i] = photograph(elsewhere.ground(), camera.camera, moments[i].truth);
    }
    flight.telemetry = std::span(telemetry).first(images.size());
    flight.area = PlaneBox{-100, -100, 100, 100};
  }
  std::optional<NoFixDiagnosis> diagnosis() const {
    return diagnose_no_fix(flight, {.elapsed_s = [] { return 0.0; }});
  }
};

void expect_cause(const std::optional<NoFixDiagnosis>& found, NoFixCause cause, const char* text) {
  ASSERT_TRUE(found.has_value()) << "no diagnosis";
  EXPECT_EQ(found->cause, cause) << found->text;
  EXPECT_THAT(found->text, HasSubstr(text));
  EXPECT_GE(found->frames_matched, 3);
}

TEST(NoFixDiagnosis, HeightsInFeet) {
  WronglyStated stated;
  for (Telemetry& telemetry : stated.telemetry) *telemetry.agl_m /= 0.3048;
  const auto found = stated.diagnosis();
  expect_cause(found, NoFixCause::height, "in feet");
  EXPECT_NEAR(found->height_factor, 0.3048, 0.015);
}

TEST(NoFixDiagnosis, HeightsAboveSeaLevel) {
  WronglyStated stated;
  for (Telemetry& telemetry : stated.telemetry) *telemetry.agl_m += 450;
  stated.flight.ground_msl_m = 450;
  const auto found = stated.diagnosis();
  expect_cause(found, NoFixCause::height, "above sea level (the ground lies at 450 m)");
  EXPECT_NEAR(found->height_factor, 100.0 / 550, 0.02);
}

TEST(NoFixDiagnosis, TwiceTheFocalLength) {
  WronglyStated stated;
  stated.camera.camera.fx *= 2;
  stated.camera.camera.fy *= 2;
  stated.camera.camera.distortion = {};
  const auto found = stated.diagnosis();
  expect_cause(found, NoFixCause::height, "focal length twice the true one");
  EXPECT_NEAR(found->height_factor, 2, 0.1);
}

TEST(NoFixDiagnosis, NegatedHeadings) {
  WronglyStated stated;
  for (Telemetry& telemetry : stated.telemetry) telemetry.heading_rad = -*telemetry.heading_rad;
  expect_cause(stated.diagnosis(), NoFixCause::heading, "counter-clockwise (negated)");
}

TEST(NoFixDiagnosis, TheTopOfTheImagePointsToTheTail) {
  WronglyStated stated;
  for (Telemetry& telemetry : stated.telemetry) telemetry.heading_rad = wrap_pi(*telemetry.heading_rad + kPi);
  const auto found = stated.diagnosis();
  expect_cause(found, NoFixCause::heading, "to the tail");
  EXPECT_NEAR(std::abs(*found->heading_offset_rad), kPi, radians(5));
}

TEST(NoFixDiagnosis, MagneticHeadings) {
  WronglyStated stated;
  for (Telemetry& telemetry : stated.telemetry) telemetry.heading_rad = wrap_pi(*telemetry.heading_rad - radians(22));
  const auto found = stated.diagnosis();
  expect_cause(found, NoFixCause::heading, "magnetic");
  EXPECT_NEAR(*found->heading_offset_rad, radians(22), radians(4));
}

TEST(NoFixDiagnosis, FeetAndNegatedHeadingsTogether) {
  WronglyStated stated;
  for (Telemetry& telemetry : stated.telemetry) {
    *telemetry.agl_m /= 0.3048;
    telemetry.heading_rad = -*telemetry.heading_rad;
  }
  const auto found = stated.diagnosis();
  expect_cause(found, NoFixCause::height_and_heading, "in feet");
  EXPECT_THAT(found->text, HasSubstr("negated"));
}

TEST(NoFixDiagnosis, LongitudeAndLatitudeOfTheStartSwapped) {
  WronglyStated stated;
  stated.flight.start = LonLat{start().lat_deg, start().lon_deg};
  expect_cause(stated.diagnosis(), NoFixCause::start, "longitude and latitude of the start swapped?");
}

TEST(NoFixDiagnosis, AStartOutsideOfThePackage) {
  WronglyStated stated;
  stated.flight.start = place_of({3000, 500});
  const auto found = stated.diagnosis();
  expect_cause(found, NoFixCause::start, "from the start: is the start wrong?");
  EXPECT_LT(distance_m(stated.frame.plane_from_lonlat(*found->place), {-60, -45}), 20);
}

// Around a start, but for the eight heights between the likely ones, which are tried below, without a start: seven
// hypotheses come before them, two of height and heading together after them.
TEST(NoFixDiagnosis, PhotosOfAnotherPlaceMatchNowhere) {
  WronglyStated stated;
  stated.photograph_another_place();
  int asked = 0;
  const auto found = diagnose_no_fix(
      stated.flight, {.seconds = 60, .elapsed_s = [&asked] { return ++asked <= 7 || asked > 15 ? 0.0 : 61.0; }});
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->cause, NoFixCause::nowhere) << found->text;
  EXPECT_THAT(found->text, HasSubstr("match nowhere in this package"));
  EXPECT_EQ(found->frames_matched, 0);
}

TEST(NoFixDiagnosis, PhotosOfAnotherPlaceMatchNowhereWithoutAStart) {
  WronglyStated stated;
  stated.photograph_another_place();
  stated.flight.start = std::nullopt;
  const auto found = stated.diagnosis();
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->cause, NoFixCause::nowhere) << found->text;
}

TEST(NoFixDiagnosis, HeightsInFeetWithoutAStart) {
  WronglyStated stated;
  stated.flight.start = std::nullopt;
  for (Telemetry& telemetry : stated.telemetry) *telemetry.agl_m /= 0.3048;
  expect_cause(stated.diagnosis(), NoFixCause::height, "in feet");
}

// Photos without any attitude, as most cameras make them.
TEST(NoFixDiagnosis, HeightsInFeetWithoutHeadings) {
  WronglyStated stated;
  for (Telemetry& telemetry : stated.telemetry) {
    *telemetry.agl_m /= 0.3048;
    telemetry.heading_rad = telemetry.pitch_rad = telemetry.roll_rad = std::nullopt;
  }
  expect_cause(stated.diagnosis(), NoFixCause::height, "in feet");
}

TEST(NoFixDiagnosis, NothingIsWrongWithAGoodFlight) {
  WronglyStated stated;
  EXPECT_FALSE(stated.diagnosis().has_value());
  stated.flight.start = std::nullopt;
  EXPECT_FALSE(stated.diagnosis().has_value());
}

TEST(NoFixDiagnosis, SaysNothingOfTwoUsableFrames) {
  WronglyStated stated;
  stated.photograph_another_place();
  for (std::size_t i = 2; i < stated.images.size(); ++i) stated.images[i] = cv::Mat();
  EXPECT_FALSE(stated.diagnosis().has_value());
}

TEST(NoFixDiagnosis, OutOfTimeItSaysWhatWasNotTried) {
  WronglyStated stated;
  stated.photograph_another_place();
  const auto found = diagnose_no_fix(stated.flight, {.seconds = 1, .elapsed_s = [] { return 2.0; }});
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->cause, NoFixCause::nowhere);
  EXPECT_THAT(found->text, HasSubstr("others were not all tried"));
}

TEST(NoFixDiagnosis, CanBeCancelled) {
  WronglyStated stated;
  EXPECT_THROW(diagnose_no_fix(stated.flight, {.cancel = Cancel([] { return true; })}), Interrupted);
}

TEST(NoFixWatch, IsDueOnceAfterThreeFailures) {
  NoFixWatch watch;
  EXPECT_FALSE(watch.due(AnchorVerdict::ambiguous));
  EXPECT_FALSE(watch.due(AnchorVerdict::frame_unfit)) << "no failure of the map";
  EXPECT_FALSE(watch.due(AnchorVerdict::not_tried));
  EXPECT_FALSE(watch.due(AnchorVerdict::few_inliers));
  EXPECT_TRUE(watch.due(AnchorVerdict::no_map));
  EXPECT_FALSE(watch.due(AnchorVerdict::ambiguous));
  EXPECT_FALSE(watch.anchored());
}

TEST(NoFixWatch, NeverAfterAnAnchor) {
  NoFixWatch watch;
  EXPECT_FALSE(watch.due(AnchorVerdict::accepted));
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(watch.due(AnchorVerdict::ambiguous));
  EXPECT_TRUE(watch.anchored());
}

}  // namespace
}  // namespace nadir::test
