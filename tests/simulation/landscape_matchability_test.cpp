// The map as a satellite would see a made-up landscape, probed where we know what lies there: villages are found again,
// water and bare fields are not.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "simulation/landscape.hpp"
#include "simulation/landscape_rendering.hpp"
#include "simulation/painter.hpp"
#include "vision/matchability.hpp"

namespace nadir {
namespace {

constexpr double kSize_m = 1500;

class MatchabilityOfAWorld : public ::testing::Test {
 protected:
  static MatchabilityOptions options() {
    MatchabilityOptions options;
    options.footprint_m = 90;
    options.gsd_m = 1;
    options.radius_m = 80;
    options.typical_texture = 2.8;  // of these worlds
    options.limits = {.good_ratio = 0.8, .weak_ratio = 0.9, .min_score = 0.16, .min_valid = 0.6};
    return options;
  }
  PlaceMatchability at(GroundPoint position) const {
    const int side = static_cast<int>(2 * probe_.reach_m());
    const PixelGrid grid{
        1,    kSize_m, static_cast<int>(position.x) - side / 2, static_cast<int>(kSize_m - position.y) - side / 2,
        side, side};
    MapWindow window;
    window.gsd_m = 1;
    cv::cvtColor(render_view(land_, painter_, View::satellite, grid), window.image, cv::COLOR_BGR2GRAY);
    window.mask = cv::Mat(window.image.size(), CV_8UC1, cv::Scalar(255));
    return probe_.probe(window, 1);
  }
  static bool well_inside(GroundPoint position) {
    return std::min(position.x, position.y) > 140 && std::max(position.x, position.y) < kSize_m - 140;
  }

  Landscape land_ = generate_landscape(3, kSize_m);
  Painter painter_{land_, Season::may};
  MatchabilityProbe probe_{options()};
};

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(std::max<std::size_t>(1, values.size()));
}

TEST_F(MatchabilityOfAWorld, VillagesAreGoodAndRemoteFieldsAreWorse) {
  // Built-up places: around the village. Empty ones: farthest from houses, trees and roads.
  std::vector<double> village, empty, village_score, empty_score;
  ASSERT_TRUE(well_inside(land_.village));
  for (const GroundPoint offset :
       {GroundPoint{0, 0}, GroundPoint{40, 0}, GroundPoint{-40, 0}, GroundPoint{0, 40}, GroundPoint{0, -40}}) {
    const PlaceMatchability place = at(land_.village + offset);
    EXPECT_EQ(place.cls, MatchClass::good);
    village.push_back(place.ratio);
    village_score.push_back(place.score);
  }
  struct Field {
    double clearance_m;
    GroundPoint position;
  };
  std::vector<Field> fields;
  for (double x = 150; x < kSize_m - 140; x += 50) {
    for (double y = 150; y < kSize_m - 140; y += 50) {
      const GroundPoint position{x, y};
      double clearance = 1e9;
      for (const Building& building : land_.buildings)
        clearance = std::min(clearance, cv::norm(building.centre - position));
      for (const Tree& tree : land_.trees) clearance = std::min(clearance, cv::norm(tree.centre - position));
      const auto hit = land_.fields.find(land_.fields.uv_from_ground(position));
      clearance = std::min(clearance, hit.border_m);
      fields.push_back({clearance, position});
    }
  }
  std::sort(fields.begin(), fields.end(), [](const Field& a, const Field& b) { return a.clearance_m > b.clearance_m; });
  int poor = 0;
  for (std::size_t i = 0; i < 5; ++i) {
    const PlaceMatchability place = at(fields[i].position);
    empty.push_back(place.ratio);
    empty_score.push_back(place.score);
    poor += place.cls == MatchClass::poor ? 1 : 0;
    RecordProperty("clearance_m", static_cast<int>(fields[i].clearance_m));
  }
  EXPECT_LT(mean_of(village) + 0.2, mean_of(empty));
  EXPECT_GT(mean_of(village_score), mean_of(empty_score) + 0.1);
  EXPECT_GE(poor, 3);
}

TEST_F(MatchabilityOfAWorld, OpenWaterIsPoor) {
  // A lake as large as what a frame sees and the flight searches, where the land has none of that size.
  land_.ponds = {{land_.village, 160, 7}};
  land_.buildings.clear();
  land_.trees.clear();
  land_.plots.clear();
  land_.roads.clear();
  land_.lanes.clear();
  for (Cut& cut : land_.fields.cuts) cut.border = Border::furrow;  // no bridges
  const PlaceMatchability place = at(land_.village);
  EXPECT_EQ(place.cls, MatchClass::poor);
  EXPECT_LT(place.score, 0.14);
  EXPECT_LT(place.texture, 1.2);
}

}  // namespace
}  // namespace nadir
