#include "estimation/localizer.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
const LonLat kOrigin{11.2, 48.1};

const test::Landscape& landscape() {
  static const test::Landscape world(31, 220);
  return world;
}

// The landscape as an encoded tile set, in another light than the camera's.
class LandscapeTiles final : public TileSource {
 public:
  explicit LandscapeTiles(ImageFormat format) : format_(format), frame_(kOrigin) {}

  ZoomRange zooms() const override { return {18, 18}; }
  std::optional<Bytes> read(const TileKey& key) const override {
    if (key.z != 18) return std::nullopt;
    const auto known = tiles_.find(key);
    if (known != tiles_.end()) return known->second;
    const Enu north_west = corner(key, 0, 0), south_east = corner(key, kTileSize, kTileSize);
    const double reach = landscape().half_side_m();
    if (std::max({-south_east.east_m, north_west.east_m, south_east.north_m, -north_west.north_m}) > reach) {
      return tiles_[key] = std::nullopt;
    }
    const Enu north_east = corner(key, kTileSize, 0), south_west = corner(key, 0, kTileSize);
    cv::Mat tile(kTileSize, kTileSize, CV_8UC1);
    for (int r = 0; r < kTileSize; ++r) {
      for (int c = 0; c < kTileSize; ++c) {  // within a tile the plane is as good as linear
        const double u = (c + 0.5) / kTileSize, v = (r + 0.5) / kTileSize;
        const auto mix = [&](double nw, double ne, double sw, double se) {
          return (1 - v) * ((1 - u) * nw + u * ne) + v * ((1 - u) * sw + u * se);
        };
        const PlanePoint place{mix(north_west.east_m, north_east.east_m, south_west.east_m, south_east.east_m),
                               mix(north_west.north_m, north_east.north_m, south_west.north_m, south_east.north_m)};
        tile.at<std::uint8_t>(r, c) = cv::saturate_cast<std::uint8_t>(40 + 0.7 * landscape().grey(place));
      }
    }
    return tiles_[key] = encode_image(tile, format_, 90);
  }

 private:
  Enu corner(const TileKey& key, int column, int row) const {
    return frame_.enu_from_lonlat(lonlat_from_pixel(
        {static_cast<double>(key.x) * kTileSize + column, static_cast<double>(key.y) * kTileSize + row}, key.z));
  }

  ImageFormat format_;
  LocalFrame frame_;
  mutable std::map<TileKey, std::optional<Bytes>> tiles_;
};

const LandscapeTiles& tiles() {
  static const LandscapeTiles set(ImageFormat::jpeg);
  return set;
}

CameraFile camera_file() {
  CameraFile file;
  file.camera = test::small_camera();
  file.camera.distortion = {-0.1, 0.01, 0, 0, 0};
  file.uncertainty = {radians(1), 0.015, radians(1)};
  return file;
}

struct Moment {
  CameraPose truth;
  Telemetry telemetry;
  cv::Mat image;
};

// A gentle curve at 17 m/s; the telemetry's heading is 1 degree off, its height 1 %, its tilt half a degree.
std::vector<Moment> flight(int frames) {
  std::vector<Moment> moments;
  Random random(1);
  PlanePoint at{-60, -45};
  double heading = radians(50);
  for (int i = 0; i < frames; ++i) {
    Moment moment;
    moment.truth = {at, 100 + 2.0 * std::sin(i), {heading, radians(3), radians(i % 2 == 0 ? 5 : -2)}};
    moment.image = test::photograph(landscape().ground(), camera_file().camera, moment.truth);
    Telemetry& t = moment.telemetry;
    t.frame = "frame" + std::to_string(i) + ".jpg";
    t.time_s = 10 + 1.5 * i;
    t.agl_m = moment.truth.agl_m * 1.01;
    t.heading_rad = wrap_pi(heading - radians(1) + random.normal(0, radians(0.2)));
    t.pitch_rad = moment.truth.attitude.pitch_rad + random.normal(0, radians(0.5));
    t.roll_rad = moment.truth.attitude.roll_rad + random.normal(0, radians(0.5));
    moments.push_back(moment);
    at = {at.east_m + 25 * std::sin(heading), at.north_m + 25 * std::cos(heading)};
    heading += radians(4);
  }
  return moments;
}

const std::vector<Moment>& short_flight() {
  static const std::vector<Moment> moments = flight(4);
  return moments;
}

LonLat place_of(PlanePoint point) { return LocalFrame(kOrigin).lonlat_from_enu(point.east_m, point.north_m); }

LonLat start() { return place_of({-48, -60}); }  // 19 m off

LocalizerConfig config() {
  LocalizerConfig c;
  c.start_sigma_m = 20;
  c.map_sigma_m = 1;
  return c;
}

double off_m(const Estimate& estimate, const Moment& moment) {
  if (!estimate.position) return 1e9;
  const Enu enu = LocalFrame(kOrigin).enu_from_lonlat(*estimate.position);
  return std::hypot(enu.east_m - moment.truth.position.east_m, enu.north_m - moment.truth.position.north_m);
}

void expect_sound(const Estimate& estimate) {
  EXPECT_TRUE(std::isfinite(estimate.sigma_m));
  EXPECT_GE(estimate.sigma_m, 0);
  EXPECT_TRUE(estimate.covariance_m2.allFinite());
  EXPECT_EQ(estimate.position.has_value(), estimate.source != SourceLabel::no_fix);
  if (!estimate.position) return;
  EXPECT_GT(estimate.sigma_m, 0) << "never without a sigma";
  EXPECT_TRUE(std::isfinite(estimate.position->lon_deg) && std::isfinite(estimate.position->lat_deg));
}

TEST(Localizer, FollowsAFlightOverItsMap) {
  Localizer localizer(camera_file(), LocalFrame(kOrigin), &tiles(), start(), config());
  std::vector<Estimate> told;
  for (const Moment& moment : short_flight()) {
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    expect_sound(report.estimate);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted)
        << name_of(report.anchor.verdict) << " " << report.anchor.ratio << " " << report.anchor.inliers;
    EXPECT_EQ(report.estimate.source, SourceLabel::satellite_anchored);
    EXPECT_EQ(report.estimate.frame, moment.telemetry.frame);
    EXPECT_EQ(report.estimate.time_s, moment.telemetry.time_s);
    EXPECT_EQ(report.estimate.anchor_age_s, 0.0);
    EXPECT_LT(off_m(report.estimate, moment), 3.0) << moment.telemetry.frame;
    EXPECT_LT(off_m(report.estimate, moment), 3 * report.estimate.sigma_m);
    EXPECT_LT(report.estimate.sigma_m, 10);
    EXPECT_FALSE(report.anchor.rectified.empty());
    EXPECT_EQ(report.anchor.rectified.size(), report.anchor.matched_map.size());
    told.push_back(report.estimate);
  }
  const auto refined = localizer.refined();
  ASSERT_EQ(refined.size(), told.size());
  for (std::size_t i = 0; i < refined.size(); ++i) {
    EXPECT_EQ(refined[i].frame, told[i].frame);
    EXPECT_LT(off_m(refined[i], short_flight()[i]), 3.0);
    expect_sound(refined[i]);
  }
}

TEST(Localizer, BetweenAnchorsItIsCarriedByOdometry) {
  Localizer localizer(camera_file(), LocalFrame(kOrigin), nullptr, place_of(short_flight()[0].truth.position), [] {
    LocalizerConfig c = config();
    c.start_sigma_m = 3;
    return c;
  }());
  double last_sigma = 0;
  for (std::size_t i = 0; i < short_flight().size(); ++i) {
    const FrameReport report = localizer.process(short_flight()[i].image, short_flight()[i].telemetry);
    expect_sound(report.estimate);
    EXPECT_EQ(report.odometry.tracked, i > 0);
    EXPECT_EQ(report.estimate.source, i > 0 ? SourceLabel::vo_extrapolated : SourceLabel::dead_reckoned);
    EXPECT_GE(report.estimate.sigma_m, last_sigma) << "nothing but anchors makes it surer";
    EXPECT_FALSE(report.estimate.anchor_age_s);
    EXPECT_LT(off_m(report.estimate, short_flight()[i]), 3 * report.estimate.sigma_m);
    last_sigma = report.estimate.sigma_m;
  }
  EXPECT_LT(last_sigma, 20);
}

TEST(Localizer, TwiceTheSame) {
  std::vector<Estimate> told[2];
  for (auto& run : told) {
    Localizer localizer(camera_file(), LocalFrame(kOrigin), &tiles(), start(), config());
    for (std::size_t i = 0; i < 1; ++i) {
      run.push_back(localizer.process(short_flight()[i].image, short_flight()[i].telemetry).estimate);
    }
  }
  for (std::size_t i = 0; i < 1; ++i) {
    EXPECT_EQ(told[0][i].position, told[1][i].position);
    EXPECT_EQ(told[0][i].sigma_m, told[1][i].sigma_m);
    EXPECT_EQ(told[0][i].covariance_m2, told[1][i].covariance_m2);
    EXPECT_EQ(told[0][i].source, told[1][i].source);
    EXPECT_EQ(told[0][i].anchor_inliers, told[1][i].anchor_inliers);
    EXPECT_EQ(told[0][i].anchor_ratio, told[1][i].anchor_ratio);
  }
}

TEST(Localizer, ColourFramesAreTheSameAsGrey) {
  Localizer grey(camera_file(), LocalFrame(kOrigin), nullptr, start(), config());
  Localizer colour(camera_file(), LocalFrame(kOrigin), nullptr, start(), config());
  for (std::size_t i = 0; i < 2; ++i) {
    const Moment& moment = short_flight()[i];
    cv::Mat bgr;
    cv::merge(std::vector<cv::Mat>(3, moment.image), bgr);
    EXPECT_EQ(grey.process(moment.image, moment.telemetry).estimate.position,
              colour.process(bgr, moment.telemetry).estimate.position);
  }
}

TEST(Localizer, WithoutMapAndStartThereIsNoFix) {
  Localizer localizer(camera_file(), LocalFrame(kOrigin), nullptr, std::nullopt, config());
  for (std::size_t i = 0; i < 2; ++i) {
    const FrameReport report = localizer.process(short_flight()[i].image, short_flight()[i].telemetry);
    EXPECT_EQ(report.estimate.source, SourceLabel::no_fix);
    EXPECT_FALSE(report.estimate.position);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::not_tried);
  }
  EXPECT_EQ(localizer.refined().size(), 2U);
  for (const Estimate& estimate : localizer.refined()) EXPECT_FALSE(estimate.position);
}

TEST(Localizer, OffTheMap) {
  Localizer localizer(camera_file(), LocalFrame(kOrigin), &tiles(), place_of({5000, 5000}), config());
  const FrameReport report = localizer.process(short_flight()[0].image, short_flight()[0].telemetry);
  EXPECT_EQ(report.anchor.verdict, AnchorVerdict::no_map);
  EXPECT_NE(report.estimate.source, SourceLabel::satellite_anchored);
}

// The whole neighbourhood is another one than the map's: nothing may be anchored.
TEST(Localizer, AForeignLandscapeIsNotAnchored) {
  const test::Landscape other(77, 160);
  Localizer localizer(camera_file(), LocalFrame(kOrigin), &tiles(), start(), config());
  for (std::size_t i = 0; i < 3; ++i) {
    const cv::Mat image = test::photograph(other.ground(), camera_file().camera, short_flight()[i].truth);
    const FrameReport report = localizer.process(image, short_flight()[i].telemetry);
    EXPECT_NE(report.anchor.verdict, AnchorVerdict::accepted) << report.anchor.ratio << " " << report.anchor.inliers;
    expect_sound(report.estimate);
  }
}

TEST(Localizer, UnfitFramesAreBridged) {
  Localizer localizer(camera_file(), LocalFrame(kOrigin), &tiles(), start(), config());
  const auto& moments = short_flight();
  const double sure = localizer.process(moments[0].image, moments[0].telemetry).estimate.sigma_m;
  for (const cv::Mat& image : {cv::Mat(), cv::Mat(240, 320, CV_8UC1, cv::Scalar(0))}) {
    Telemetry telemetry = moments[1].telemetry;
    telemetry.time_s = image.empty() ? 11 : 11.5;
    const FrameReport report = localizer.process(image, telemetry);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::frame_unfit);
    EXPECT_EQ(report.estimate.source, SourceLabel::dead_reckoned);
    EXPECT_GT(report.estimate.sigma_m, sure);
    EXPECT_FALSE(report.odometry.tracked);
    expect_sound(report.estimate);
  }
  const FrameReport after = localizer.process(moments[2].image, moments[2].telemetry);
  EXPECT_EQ(after.anchor.verdict, AnchorVerdict::accepted);
  EXPECT_LT(off_m(after.estimate, moments[2]), 3.0);
  EXPECT_GT(after.estimate.segment, 0) << "tracking was lost in between";
}

// Telemetry as it comes from a confused autopilot. Whatever it says, the estimate stays sound, and when the telemetry
// recovers the localizer does.
struct Broken {
  const char* name;
  std::function<void(Telemetry&)> damage;
};

class BrokenTelemetry : public testing::TestWithParam<Broken> {};
INSTANTIATE_TEST_SUITE_P(
    Localizer, BrokenTelemetry,
    testing::Values(Broken{"NanHeight", [](Telemetry& told) { told.agl_m = kNaN; }},
                    Broken{"NegativeHeight", [](Telemetry& told) { told.agl_m = -30; }},
                    Broken{"ZeroHeight", [](Telemetry& told) { told.agl_m = 0; }},
                    Broken{"InfiniteHeight",
                           [](Telemetry& told) { told.agl_m = std::numeric_limits<double>::infinity(); }},
                    Broken{"HugeHeight", [](Telemetry& told) { told.agl_m = 1e9; }},
                    Broken{"NoHeight", [](Telemetry& told) { told.agl_m.reset(); }},
                    Broken{"NanHeading", [](Telemetry& told) { told.heading_rad = kNaN; }},
                    Broken{"HugeHeading", [](Telemetry& told) { told.heading_rad = 1e300; }},
                    Broken{"NanPitch", [](Telemetry& told) { told.pitch_rad = kNaN; }},
                    Broken{"NanRoll", [](Telemetry& told) { told.roll_rad = kNaN; }},
                    Broken{"UpsideDown", [](Telemetry& told) { told.roll_rad = kPi; }},
                    Broken{"NoTilt", [](Telemetry& told) { told.pitch_rad.reset(), told.roll_rad.reset(); }},
                    Broken{"NanTime", [](Telemetry& told) { told.time_s = kNaN; }},
                    Broken{"BackInTime", [](Telemetry& told) { told.time_s -= 100; }},
                    Broken{"FarFuture", [](Telemetry& told) { told.time_s += 1e7; }},
                    Broken{"SameTime", [](Telemetry& told) { told.time_s = 10; }}),
    [](const auto& test) { return test.param.name; });

TEST_P(BrokenTelemetry, NeverThrowsAndRecovers) {
  const auto& moments = short_flight();
  Localizer localizer(camera_file(), LocalFrame(kOrigin), nullptr, start(), config());
  for (std::size_t i = 0; i < 3; ++i) {
    Telemetry telemetry = moments[i].telemetry;
    if (i == 1) GetParam().damage(telemetry);
    FrameReport report;
    ASSERT_NO_THROW(report = localizer.process(moments[i].image, telemetry));
    expect_sound(report.estimate);
    if (report.estimate.position) {
      EXPECT_LT(off_m(report.estimate, moments[i]), 4 * report.estimate.sigma_m) << i;
    }
  }
  for (const Estimate& estimate : localizer.refined()) expect_sound(estimate);
}

// The very first frame may already be the broken one.
TEST_P(BrokenTelemetry, FromTheFirstFrame) {
  Localizer localizer(camera_file(), LocalFrame(kOrigin), nullptr, start(), config());
  Telemetry telemetry = short_flight()[0].telemetry;
  GetParam().damage(telemetry);
  for (int i = 0; i < 1; ++i) {
    FrameReport report;
    ASSERT_NO_THROW(report = localizer.process(short_flight()[0].image, telemetry));
    expect_sound(report.estimate);
  }
}

// The same over a map, one damage after the other.
TEST(Localizer, BrokenTelemetryOverAMap) {
  const auto& moments = short_flight();
  Localizer localizer(camera_file(), LocalFrame(kOrigin), &tiles(), start(), config());
  const std::vector<std::function<void(Telemetry&)>> damages = {
      [](Telemetry& told) { told.agl_m = kNaN; }, [](Telemetry& told) { told.agl_m = 1e9; },
      [](Telemetry& told) { told.heading_rad = kNaN; }, [](Telemetry& told) { told.roll_rad = kPi; }};
  for (const auto& damage : damages) {
    Telemetry telemetry = moments[0].telemetry;
    damage(telemetry);
    FrameReport report;
    ASSERT_NO_THROW(report = localizer.process(moments[0].image, telemetry));
    expect_sound(report.estimate);
  }
  const FrameReport after = localizer.process(moments[1].image, moments[1].telemetry);
  expect_sound(after.estimate);
  EXPECT_LT(off_m(after.estimate, moments[1]), std::max(4.0, 4 * after.estimate.sigma_m));
}

TEST(Localizer, ARepeatedFrameStaysPut) {
  Localizer localizer(camera_file(), LocalFrame(kOrigin), &tiles(), start(), config());
  const Moment& moment = short_flight()[0];
  const Estimate first = localizer.process(moment.image, moment.telemetry).estimate;
  Telemetry again = moment.telemetry;
  for (int i = 0; i < 1; ++i) {
    again.time_s += 1;
    const Estimate estimate = localizer.process(moment.image, again).estimate;
    expect_sound(estimate);
    EXPECT_LT(off_m(estimate, moment), 3.0);
    EXPECT_GT(estimate.sigma_m, 0.6 * first.sigma_m) << "the same frame twice is no second opinion";
  }
}

TEST(Localizer, MapSigmaFollowsFromCe90) {
  // 90 % of a circular normal distribution lie within sqrt(2 ln 10) sigma.
  EXPECT_NEAR(map_sigma_from_ce90(std::sqrt(2 * std::log(10.0))), 1, 1e-3);
}

}  // namespace
}  // namespace nadir
