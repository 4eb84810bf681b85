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
  EXPECT_GE(prediction.legs.front().probability, kGoodLook);
  EXPECT_TRUE(prediction.legs.front().reason.empty());
  const PredictedLeg& last = prediction.legs.back();
  EXPECT_EQ(last.verdict, LegVerdict::poor);
  EXPECT_TRUE(last.beyond_alert_limit || last.hpl_m < 100);
  EXPECT_EQ(prediction.looks.back().probability, 0) << "beyond the map nothing anchors";
  bool water = false;
  for (const PredictedLeg& leg : prediction.legs) water |= leg.reason.find("little structure") != std::string::npos;
  EXPECT_TRUE(water);
  double length_m = 0;
  for (const PredictedLeg& leg : prediction.legs) length_m += leg.length_m;
  EXPECT_NEAR(length_m, prediction.route_m, 1e-6);
  EXPECT_NEAR(prediction.good_m + prediction.fair_m + prediction.poor_m, prediction.route_m, 1e-6);
  // Over the water the level grows with every metre.
  EXPECT_GT(prediction.looks[20].hpl_m, prediction.looks[12].hpl_m);
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

TEST(RoutePrediction, TheLevelFollowsFromTheLooks) {
  std::vector<PredictedLook> looks(60);
  for (std::size_t i = 0; i < looks.size(); ++i) {
    looks[i].at_m = 50.0 * static_cast<double>(i);
    looks[i].probability = i < 20 || i >= 40 ? 0.97 : 0;
  }
  predict_protection(looks);
  EXPECT_NEAR(looks[19].hpl_m, kAnchoredProtection_m, 1e-9) << "this look anchors in more than nine of ten flights";
  EXPECT_NEAR(looks[39].since_anchor_m, 20 * 50, 1e-9);
  EXPECT_NEAR(looks[39].hpl_m, kAnchoredProtection_m + kProtectionPerMetre * 1000, 1e-9);
  EXPECT_NEAR(looks[40].hpl_m, kAnchoredProtection_m, 1e-9);
  for (PredictedLook& look : looks) look.probability = 0.7;
  predict_protection(looks);
  EXPECT_NEAR(looks[30].since_anchor_m, 2 * 50, 1e-9) << "two independent looks of 0.7 fail once in eleven times";
  const auto legs = legs_of(looks, 100, 50.0 * 59);
  ASSERT_EQ(legs.front().verdict, LegVerdict::fair);
}

TEST(RoutePrediction, DocumentsAreGeoJsonAndStable) {
  const RoutePrediction prediction = predicted(coastal_mission(-300, 500, 150));
  const auto map = prediction_geojson(prediction);
  EXPECT_EQ(map["type"], "FeatureCollection");
  EXPECT_EQ(map["features"].size(), prediction.legs.size() + prediction.looks.size());
  EXPECT_EQ(map["features"][0]["geometry"]["type"], "LineString");
  const auto document = prediction_json(prediction);
  EXPECT_EQ(document["schema"], "nadir.prediction/1");
  for (const char* key : {"verdict", "beyond_alert_limit", "begin_m", "length_m", "from", "to", "probability", "hpl_m",
                          "reason", "remedies"}) {
    EXPECT_TRUE(document["legs"][0].contains(key)) << key;
  }
}

}  // namespace
}  // namespace nadir
