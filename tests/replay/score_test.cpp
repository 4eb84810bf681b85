#include "replay/score.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/random.hpp"
#include "replay/track_files.hpp"

namespace nadir {
namespace {

const LocalFrame kFrame({8.5, 47.4});

Estimate estimate_at(double east_m, double north_m, double sigma_m = 5) {
  Estimate estimate;
  estimate.frame = "f.jpg";
  estimate.position = kFrame.lonlat_from_plane({east_m, north_m});
  estimate.sigma_m = sigma_m;
  estimate.covariance_m2 = Eigen::Matrix2d::Identity() * sigma_m * sigma_m;
  estimate.source = SourceLabel::satellite_anchored;
  return estimate;
}

TEST(Score, CountsErrorsAndSources) {
  std::vector<Estimate> estimates{estimate_at(3, 4), estimate_at(0, 30), estimate_at(60, 0), estimate_at(0, 1)};
  estimates[3].source = SourceLabel::no_fix;
  estimates[3].position.reset();
  const Truth truth(4, LonLat{8.5, 47.4});
  const Score s = score(estimates, truth, kFrame);
  EXPECT_EQ(s.frames, 4U);
  EXPECT_DOUBLE_EQ(s.localized_share, 0.75);
  ASSERT_TRUE(s.errors.has_value());
  EXPECT_EQ(s.errors->scored, 3U);
  EXPECT_NEAR(s.errors->median_m, 30, 1e-3);
  EXPECT_NEAR(s.errors->mean_m, 95.0 / 3, 1e-3);
  EXPECT_NEAR(s.errors->max_m, 60, 1e-3);
  EXPECT_DOUBLE_EQ(s.errors->within_20_m_share, 0.25);  // of the frames with truth
  EXPECT_DOUBLE_EQ(s.errors->within_50_m_share, 0.5);
  EXPECT_EQ(s.errors->wrong_anchors, 1U);
}

TEST(Score, WithoutTruthThereAreNoErrors) {
  EXPECT_FALSE(score({estimate_at(0, 0)}, Truth(1), kFrame).errors.has_value());
}

// Errors drawn from the stated covariance fall into its ellipses as often as they should.
TEST(Score, EllipsesContainTheirShare) {
  Random random(4);
  std::vector<Estimate> estimates;
  for (int i = 0; i < 20'000; ++i) {
    const double a = random.normal(), b = random.normal();
    Estimate estimate = estimate_at(6 * a + 1 * b, 2 * b);
    estimate.covariance_m2 << 37, 2, 2, 4;
    estimates.push_back(estimate);
  }
  const Score s = score(estimates, Truth(estimates.size(), LonLat{8.5, 47.4}), kFrame);
  EXPECT_NEAR(s.errors->inside_50_share, 0.50, 0.015);
  EXPECT_NEAR(s.errors->inside_95_share, 0.95, 0.007);
}

TEST(EstimatesCsv, LeavesUnknownCellsEmpty) {
  Estimate estimate;
  estimate.frame = "a,b.jpg";
  estimate.time_s = 1.5;
  EXPECT_EQ(EstimatesCsv::row(estimate), "\"a,b.jpg\",1.500,,,,no_fix,0,,,,0.0,");
  estimate = estimate_at(0, 0);
  estimate.anchor_age_s = 2;
  estimate.anchor_inliers = 40;
  estimate.anchor_ratio = 0.25;
  estimate.latency_ms = 12.34;
  EXPECT_EQ(EstimatesCsv::row(estimate),
            "f.jpg,0.000,47.40000000,8.50000000,5.000,satellite_anchored,0,2.000,40,0.2500,12.3,");
  estimate.hpl_m = 31.25;
  EXPECT_TRUE(EstimatesCsv::row(estimate).ends_with(",12.3,31.250"));
  estimate.position.reset();
  EXPECT_TRUE(EstimatesCsv::row(estimate).ends_with(",12.3,")) << "without a position it is about nothing";
}

// Programs that read columns by number: what was there stays where it was.
TEST(EstimatesCsv, TheProtectionLevelIsTheLastColumn) {
  EXPECT_EQ(EstimatesCsv::header(),
            "frame,time_s,lat_deg,lon_deg,sigma_m,source,segment,anchor_age_s,anchor_inliers,anchor_ratio,latency_ms,"
            "hpl_m");
}

Estimate with_level(double error_m, std::optional<double> hpl_m) {
  Estimate estimate = estimate_at(error_m, 0);
  estimate.hpl_m = hpl_m;
  return estimate;
}

TEST(IntegrityFigures, CountTheRegionsOfTheStanfordDiagram) {
  std::vector<Estimate> estimates{with_level(5, 20),    with_level(19, 20),  with_level(5, 100),  // available
                                  with_level(30, 20),   with_level(99, 20),                       // misleading
                                  with_level(101, 20),  with_level(500, 99),                      // hazardously
                                  with_level(5, 101),                                             // unavailable
                                  with_level(300, 200), with_level(5, {}),  // … and misleading; no level
                                  with_level(5, 20)};                       // … no position
  estimates.back().position.reset();
  const IntegrityFigures f = integrity_figures(estimates, Truth(11, LonLat{8.5, 47.4}), kFrame, 100);
  EXPECT_TRUE(f.has_truth);
  EXPECT_EQ(f.frames, 11U);
  EXPECT_EQ(f.available, 3U);
  EXPECT_EQ(f.misleading, 2U);
  EXPECT_EQ(f.hazardously_misleading, 2U);
  EXPECT_EQ(f.unavailable, 1U);
  EXPECT_EQ(f.unavailable_misleading, 1U);
  EXPECT_EQ(f.scored, 9U);
  EXPECT_EQ(f.usable, 7U);
  EXPECT_EQ(f.without_level, 1U);
  EXPECT_EQ(f.hpl_p95_m, 200);
  const IntegrityFigures strict = integrity_figures(estimates, Truth(11, LonLat{8.5, 47.4}), kFrame, 19);
  EXPECT_EQ(strict.usable, 0U);
  EXPECT_EQ(strict.hazardously_misleading, 0U) << "nobody used them";
  EXPECT_EQ(strict.unavailable, 4U);
}

TEST(IntegrityFigures, WithoutTruthOnlyAvailabilityIsKnown) {
  const IntegrityFigures f = integrity_figures({with_level(5, 20), with_level(5, 200)}, Truth(2), kFrame, 100);
  EXPECT_EQ(f.usable, 1U);
  EXPECT_EQ(f.scored, 0U);
  Summary summary;
  summary.integrity = f;
  const auto document = json_from(summary)["integrity"];
  EXPECT_EQ(document["usable_share"], 0.5);
  EXPECT_EQ(document["alert_limit_m"], 100);
  EXPECT_FALSE(document.contains("available"));
}

TEST(Track, IsGeoJson) {
  const auto document = nlohmann::json::parse(track_geojson({estimate_at(0, 0), estimate_at(10, 0)}, {}, Truth(2)));
  EXPECT_EQ(document["type"], "FeatureCollection");
  ASSERT_EQ(document["features"].size(), 3U);  // a line and two points
  EXPECT_EQ(document["features"][0]["geometry"]["type"], "LineString");
  EXPECT_NEAR(document["features"][1]["geometry"]["coordinates"][0].get<double>(), 8.5, 1e-8);
}

TEST(Summary, MatchesTheScore) {
  Summary summary;
  summary.streamed = score({estimate_at(3, 4)}, {LonLat{8.5, 47.4}}, kFrame);
  const auto document = json_from(summary);
  EXPECT_EQ(document["frames"], 1);
  EXPECT_EQ(document["sources"]["satellite_anchored"], 1);
  EXPECT_NEAR(document["median_m"].get<double>(), 5, 0.002);
  summary.integrity = integrity_figures({with_level(150, 20)}, {LonLat{8.5, 47.4}}, kFrame, 60);
  const auto integrity = json_from(summary)["integrity"];
  EXPECT_EQ(integrity["alert_limit_m"], 60);
  EXPECT_EQ(integrity["hazardously_misleading"], 1);
  EXPECT_EQ(integrity["misleading"], 0);
  EXPECT_EQ(integrity["hpl_p50_m"], 20);
  const Figures figures = figures_from(summary);
  const bool shown = std::any_of(figures.begin(), figures.end(), [](const auto& figure) {
    return figure.first == "hazardously misleading" && figure.second == "1";
  });
  EXPECT_TRUE(shown);
  EXPECT_GT(peak_memory_mb(), 1);
}

}  // namespace
}  // namespace nadir
