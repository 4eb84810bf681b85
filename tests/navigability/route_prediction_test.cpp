// Predictions along a route: over roofs and over water, at several heights; the level that follows from the looks.
#include "navigability/route_prediction.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "base/random.hpp"
#include "imagery/codecs.hpp"
#include "navigability/navigability_parameters.hpp"
#include "navigability/prediction_documents.hpp"

namespace nadir {
namespace {

using namespace parameters::navigability;

constexpr int kZoom = 18;
constexpr LonLat kShore{11.0, 48.0};

// Roofs at random places west of the shore, calm water east of it, no map beyond 900 m.
class Coast final : public TileSource {
 public:
  ZoomRange zooms() const override { return {kZoom, kZoom}; }
  std::optional<Bytes> read(const TileKey& key) const override {
    const double shore = pixel_from_lonlat(kShore, kZoom).x;
    const double west = static_cast<double>(key.x) * kTileSize - shore;
    if (west > 900 / ground_resolution_m(kZoom, kShore.lat_deg)) return std::nullopt;
    cv::Mat tile(kTileSize, kTileSize, CV_8UC3, cv::Scalar(90, 110, 100));
    Random random = Random(5).fork("tile", (std::uint64_t{key.x} << 32U) | key.y);
    for (int i = 0; i < 30; ++i) {
      const cv::RotatedRect roof(
          cv::Point2f(static_cast<float>(random.uniform(10, 246)), static_cast<float>(random.uniform(10, 246))),
          cv::Size2f(static_cast<float>(random.uniform(12, 40)), static_cast<float>(random.uniform(10, 24))),
          static_cast<float>(random.uniform(0, 180)));
      cv::Point2f corners[4];
      roof.points(corners);
      const std::vector<cv::Point> outline(corners, corners + 4);
      cv::fillConvexPoly(tile, outline, cv::Scalar::all(random.uniform(30, 230)));
    }
    const int water = static_cast<int>(std::clamp(-west, 0.0, 256.0));
    tile(cv::Rect(water, 0, kTileSize - water, kTileSize)).setTo(cv::Scalar(80, 60, 40));
    return encode_image(tile, ImageFormat::png);
  }
};

LonLat east_of_shore(double east_m) { return LocalFrame(kShore).lonlat_from_plane({east_m, 0}); }

Mission coastal_mission(double from_m, double to_m, double agl_m) {
  Mission mission;
  mission.id = "coast";
  mission.takeoff = kShore;
  mission.zoom = {kZoom, kZoom};
  mission.freshness_days = {730, 90};
  mission.route.agl_m = agl_m;
  mission.route.corridor_half_width_m = 50;
  mission.route.points = {east_of_shore(from_m), east_of_shore(to_m)};
  return mission;
}

PredictionOptions options_of(int threads = 2) {
  PredictionOptions options;
  options.camera.width = 640, options.camera.height = 360;
  options.camera.fx = options.camera.fy = 500;
  options.camera.cx = 320, options.camera.cy = 180;
  options.spacing_m = 100;
  options.threads = threads;
  return options;
}

RoutePrediction predicted(const Mission& mission, int threads = 2, std::span<const Sidecar> sidecars = {},
                          const TerrainRaster* terrain = nullptr) {
  NoProgress progress;
  const Coast tiles;
  return predict_route(mission, tiles, sidecars, terrain, options_of(threads), progress);
}

TEST(RoutePrediction, RoofsAreGoodWaterAndTheMapsEdgeArePoor) {
  const RoutePrediction prediction = predicted(coastal_mission(-700, 1500, 150));
  ASSERT_GE(prediction.looks.size(), 22U);
  EXPECT_NEAR(prediction.looks.front().frame_width_m, 150 * 640 / 500.0, 1e-9);
  EXPECT_EQ(prediction.legs.front().verdict, LegVerdict::good);
  EXPECT_GE(prediction.legs.front().anchored_share, kGoodLook);
  EXPECT_TRUE(prediction.legs.front().reason.empty());
  const PredictedLeg& last = prediction.legs.back();
  EXPECT_EQ(last.verdict, LegVerdict::poor);
  EXPECT_GT(prediction.start_m, 0) << "one look confirms no start";
  EXPECT_LT(prediction.start_m, 400);
  EXPECT_EQ(prediction.looks.back().probability, 0) << "beyond the map nothing anchors";
  bool water = false;
  for (const PredictedLeg& leg : prediction.legs) water |= leg.reason.find("little structure") != std::string::npos;
  EXPECT_TRUE(water);
  double length_m = 0;
  for (const PredictedLeg& leg : prediction.legs) length_m += leg.length_m;
  EXPECT_NEAR(length_m, prediction.route_m, 1e-6);
  EXPECT_NEAR(prediction.good_m + prediction.fair_m + prediction.poor_m, prediction.route_m, 1e-6);
  // Over the water the level grows with every metre, until there is none.
  const auto level = [&](std::size_t i) { return prediction.looks[i].hpl_m.value_or(1e9); };
  EXPECT_LT(level(6), 60);
  EXPECT_GT(level(20), level(12));
}

TEST(RoutePrediction, ThreadsDoNotMatter) {
  const Mission mission = coastal_mission(-400, 300, 150);
  EXPECT_EQ(prediction_json(predicted(mission, 1)), prediction_json(predicted(mission, 3)));
}

TEST(RoutePrediction, HeightsFollowTheirFrame) {
  Mission mission = coastal_mission(-400, -100, 150);
  mission.terrain.height_m = 30;
  mission.route.heights_m = {180, 230};
  mission.route.height_frame = HeightFrame::above_sea_level;
  const RoutePrediction prediction = predicted(mission);
  EXPECT_NEAR(prediction.looks.front().agl_m, 150, 1e-9);
  EXPECT_NEAR(prediction.looks.back().agl_m, 200, 0.5);
  EXPECT_TRUE(prediction.terrain_known);
  mission.terrain.flat = false;
  EXPECT_FALSE(predicted(mission).terrain_known);
  mission.route.heights_m = {20, 20};
  const RoutePrediction crash = predicted(mission);
  EXPECT_EQ(crash.legs.front().reason, "the route meets the ground");
}

TEST(RoutePrediction, OldImageryOfAPoorLegIsNamed) {
  Mission mission = coastal_mission(300, 700, 150);
  std::vector<Sidecar> sidecars;
  for (double east_m = 200; east_m < 800; east_m += 10) {
    Sidecar sidecar;
    sidecar.key = tile_at(east_of_shore(east_m), kZoom);
    if (sidecars.empty() || sidecars.back().key != sidecar.key) sidecars.push_back(sidecar);
  }
  std::sort(sidecars.begin(), sidecars.end(), [](const Sidecar& a, const Sidecar& b) { return a.key < b.key; });
  NoProgress progress;
  PredictionOptions options = options_of();
  options.at = UtcTime{200 * 86'400};
  const RoutePrediction prediction = predict_route(mission, Coast(), sidecars, nullptr, options, progress);
  EXPECT_EQ(prediction.looks.front().imagery_age_days, 200);
  bool named = false;
  for (const PredictedLeg& leg : prediction.legs) {
    for (const std::string& remedy : leg.remedies) named |= remedy.find("200 days old") != std::string::npos;
  }
  EXPECT_TRUE(named);
}

TEST(RoutePrediction, AnAreaAloneAndEndlessRoutesAreRefused) {
  Mission mission = coastal_mission(0, 100, 150);
  mission.route.points.clear();
  EXPECT_THROW(predicted(mission), UsageError);
  mission = coastal_mission(0, 190'000, 150);
  NoProgress progress;
  PredictionOptions options = options_of();
  options.spacing_m = 1;
  EXPECT_THROW(predict_route(mission, Coast(), {}, nullptr, options, progress), UsageError);
}

std::vector<PredictedLook> looks_with(const std::vector<std::optional<double>>& levels_m, double probability) {
  std::vector<PredictedLook> looks(levels_m.size());
  for (std::size_t i = 0; i < looks.size(); ++i) {
    looks[i].at_m = 50.0 * static_cast<double>(i);
    looks[i].probability = looks[i].anchored_share = probability;
    looks[i].hpl_m = levels_m[i];
  }
  return looks;
}

TEST(RoutePrediction, AUsualStartIsNoLegAndAnUnknownLevelIsBeyondTheLimit) {
  const auto looks = looks_with({std::nullopt, 200, 20, 25, 30, 20, 120, std::nullopt, 20, 20}, 0.97);
  const auto legs = legs_of(looks, 100, 450, 100);
  ASSERT_EQ(legs.size(), 3U);
  EXPECT_FALSE(legs[0].beyond_alert_limit);
  EXPECT_EQ(legs[0].hpl_m, 30) << "without the start";
  EXPECT_TRUE(legs[1].beyond_alert_limit);
  EXPECT_FALSE(legs[1].hpl_m);
  EXPECT_EQ(legs[2].hpl_m, 20);
  const auto long_start = legs_of(looks, 100, 450);
  ASSERT_EQ(long_start.size(), 4U);
  EXPECT_TRUE(long_start[0].beyond_alert_limit);
  EXPECT_EQ(long_start[0].last, 1U);
}

TEST(RoutePrediction, GoodGroundBehindALossIsAnchoredByThoseWhoAreNotLost) {
  auto looks = looks_with({std::nullopt, 20, 20, 20, 60, 80, 80, 80}, 0.97);
  looks[0].anchored_share = 0;  // the start waits for a second look, on every route
  for (std::size_t i = 4; i < looks.size(); ++i) looks[i].anchored_share = 0.3;
  const auto legs = legs_of(looks, 100, 350, 50);
  ASSERT_EQ(legs.size(), 2U);
  EXPECT_EQ(legs[0].verdict, LegVerdict::good);
  EXPECT_EQ(legs[1].verdict, LegVerdict::poor);
  EXPECT_NEAR(legs[1].anchored_share, 0.3, 1e-12);
}

TEST(RoutePrediction, FramesMayBeFlownCloserOrFartherThanLooksArePredicted) {
  NoProgress progress;
  PredictionOptions options = options_of();
  const Mission mission = coastal_mission(-700, 100, 150);
  const Coast tiles;
  const auto usual = predict_route(mission, tiles, {}, nullptr, options, progress);
  double start_m = 0;
  for (const double interval_s : {0.5, 6.0}) {
    options.interval_s = interval_s;
    const auto other = predict_route(mission, tiles, {}, nullptr, options, progress);
    ASSERT_EQ(other.looks.size(), usual.looks.size());
    for (std::size_t i = 0; i < other.looks.size(); ++i) {
      EXPECT_EQ(other.looks[i].probability, usual.looks[i].probability);
      EXPECT_GE(other.looks[i].beyond_share, 0);
    }
    EXPECT_GT(other.start_m, 0) << "one look confirms no start";
    EXPECT_LT(other.start_m, 500);
    EXPECT_GE(other.start_m, start_m) << "frames far apart confirm it no sooner";
    start_m = other.start_m;
  }
}

TEST(RoutePrediction, AskedForNothingElseThereIsALookForEachFrame) {
  NoProgress progress;
  PredictionOptions options = options_of();
  options.spacing_m.reset();
  options.speed_mps = 25;
  const Mission mission = coastal_mission(-500, 0, 150);
  const Coast tiles;
  const double overlapping_m = 0.3 * 150 * 360 / 500;
  for (const auto& [interval_s, spacing_m] : {std::pair{0.2, overlapping_m}, std::pair{4.0, 100.0}}) {
    options.interval_s = interval_s;
    EXPECT_NEAR(predict_route(mission, tiles, {}, nullptr, options, progress).spacing_m, spacing_m, 1e-9);
  }
}

TEST(RoutePrediction, DocumentsAreGeoJsonAndStable) {
  const RoutePrediction prediction = predicted(coastal_mission(-300, 500, 150));
  const auto map = prediction_geojson(prediction);
  EXPECT_EQ(map["type"], "FeatureCollection");
  EXPECT_EQ(map["features"].size(), prediction.legs.size() + prediction.looks.size());
  EXPECT_EQ(map["features"][0]["geometry"]["type"], "LineString");
  const auto document = prediction_json(prediction);
  EXPECT_EQ(document["schema"], "nadir.prediction/1");
  for (const char* key : {"verdict", "beyond_alert_limit", "begin_m", "length_m", "from", "to", "probability",
                          "anchored_share", "hpl_m", "reason", "remedies"}) {
    EXPECT_TRUE(document["legs"][0].contains(key)) << key;
  }
}

}  // namespace
}  // namespace nadir
