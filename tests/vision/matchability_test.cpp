// What a place must look like to be found again: the order of water, rows and parcels, and what must not matter.
#include "vision/matchability.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

constexpr MatchabilityLimits kLimits{.good_ratio = 0.8, .weak_ratio = 0.9, .min_score = 0.16, .min_valid = 0.6};

MatchabilityOptions options() {
  MatchabilityOptions options;
  options.footprint_m = 110;
  options.gsd_m = 1;
  options.radius_m = 80;
  options.distinct_m = 25;
  options.typical_texture = 4;
  options.limits = kLimits;
  return options;
}

constexpr int kSide = 270;  // 2 · (80 + 55)

MapWindow drawn(const test::Ground& ground) {
  MapWindow window;
  window.gsd_m = 1;
  window.image.create(kSide, kSide, CV_8UC1);
  window.mask = cv::Mat(kSide, kSide, CV_8UC1, cv::Scalar(255));
  for (int row = 0; row < kSide; ++row) {
    for (int column = 0; column < kSide; ++column) {
      const PlanePoint place{column - kSide / 2 + 0.5, kSide / 2 - row - 0.5};
      window.image.at<std::uint8_t>(row, column) = cv::saturate_cast<std::uint8_t>(ground(place));
    }
  }
  return window;
}

MapWindow parcels() { return drawn(test::Landscape(4, 150).ground()); }
MapWindow water() {
  return drawn([](PlanePoint p) { return 70 + 2 * std::sin(p.east_m * 0.9) * std::sin(p.north_m * 1.1); });
}
MapWindow rows() {
  return drawn([](PlanePoint p) { return 120 + 60 * std::sin(p.east_m * 0.5 + p.north_m * 0.2); });
}

TEST(Matchability, ParcelsAreMatchableWaterAndRowsAreNot) {
  const MatchabilityProbe probe(options());
  const PlaceMatchability village = probe.probe(parcels(), 1), sea = probe.probe(water(), 1),
                          crop = probe.probe(rows(), 1);
  EXPECT_EQ(village.cls, MatchClass::good);
  EXPECT_EQ(sea.cls, MatchClass::poor);
  EXPECT_EQ(crop.cls, MatchClass::poor);
  EXPECT_LT(village.ratio, 0.7);
  EXPECT_GT(crop.ratio, 0.9) << "a row further on everything is the same";
  EXPECT_GT(village.score, sea.score + 0.15);
  EXPECT_GT(village.texture, 4 * sea.texture);
  EXPECT_GT(village.entropy, crop.entropy + 0.2) << "rows have one orientation";
  EXPECT_LE(village.entropy, 1);
  EXPECT_GE(crop.entropy, 0);
}

TEST(Matchability, IsDeterministicAndEachPlaceHasItsOwnNoise) {
  const MapWindow window = parcels();
  const PlaceMatchability first = MatchabilityProbe(options()).probe(window, 7);
  EXPECT_EQ(first, MatchabilityProbe(options()).probe(window, 7));
  const PlaceMatchability other = MatchabilityProbe(options()).probe(window, 8);
  EXPECT_NE(first.score, other.score);
  EXPECT_EQ(first.entropy, other.entropy) << "what is said of the map alone knows no noise";
  EXPECT_EQ(first.texture, other.texture);
  EXPECT_EQ(first.cls, other.cls);
}

// An equalised image is no easier to match than the one it was made from.
TEST(Matchability, IsInvariantToTheContrastOfTheWholeMap) {
  const MapWindow strong = parcels();
  MapWindow middling = parcels();
  strong.image.convertTo(middling.image, CV_8U, 0.6, 40);
  MatchabilityOptions asked = options();
  asked.typical_texture = MatchabilityProbe::texture_of(strong.image, strong.mask);
  ASSERT_GT(0.6 * asked.typical_texture, 4.6) << "the test wants a picture with contrast";
  const PlaceMatchability one = MatchabilityProbe(asked).probe(strong, 3);
  asked.typical_texture *= 0.6;
  const PlaceMatchability two = MatchabilityProbe(asked).probe(middling, 3);
  EXPECT_NEAR(one.score, two.score, 0.03);
  EXPECT_NEAR(one.ratio, two.ratio, 0.08);
}

TEST(Matchability, NothingMatchesWhereTheMapIsMissing) {
  const MatchabilityProbe probe(options());
  MapWindow window = parcels();
  window.mask.setTo(0);
  window.image.setTo(0);
  PlaceMatchability none = probe.probe(window, 1);
  EXPECT_EQ(none.cls, MatchClass::poor);
  EXPECT_EQ(none.valid, 0);
  EXPECT_EQ(none.score, 0);

  window = parcels();  // the south is missing: 57 % of the footprint is left, then 80 %
  const cv::Rect most(0, kSide / 2 + 8, kSide, kSide / 2 - 8), some(0, kSide / 2 + 33, kSide, kSide / 2 - 33);
  window.mask(most).setTo(0);
  EXPECT_EQ(probe.probe(window, 1).cls, MatchClass::poor);
  window = parcels();
  window.mask(some).setTo(0);
  const PlaceMatchability rim = probe.probe(window, 1);
  EXPECT_NEAR(rim.valid, 0.8, 0.01);
  EXPECT_EQ(rim.cls, MatchClass::good);
}

TEST(Matchability, ABlackAndAWhiteMap) {
  const MatchabilityProbe probe(options());
  for (const double grey : {0.0, 255.0}) {
    const PlaceMatchability place = probe.probe(drawn([grey](PlanePoint) { return grey; }), 1);
    EXPECT_EQ(place.cls, MatchClass::poor);
    EXPECT_TRUE(std::isfinite(place.ratio) && std::isfinite(place.entropy) && std::isfinite(place.texture));
  }
}

TEST(Matchability, ClassesFollowTheLimits) {
  const MapWindow window = parcels();
  const PlaceMatchability place = MatchabilityProbe(options()).probe(window, 1);
  const auto with = [&](double good, double weak, double score) {
    MatchabilityOptions asked = options();
    asked.limits = {.good_ratio = good, .weak_ratio = weak, .min_score = score, .min_valid = 0.6};
    return MatchabilityProbe(asked).probe(window, 1).cls;
  };
  EXPECT_EQ(with(place.ratio + 0.01, 0.9, 0.1), MatchClass::good);
  EXPECT_EQ(with(place.ratio - 0.01, 0.9, 0.1), MatchClass::weak);
  EXPECT_EQ(with(place.ratio - 0.02, place.ratio - 0.01, 0.1), MatchClass::poor);
  EXPECT_EQ(with(0.8, 0.9, place.score + 0.01), MatchClass::poor);
}

}  // namespace
}  // namespace nadir
