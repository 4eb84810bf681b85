#include "replay/report.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "replay/flight_folder.hpp"

namespace nadir {
namespace {

ReportInput small_input() {
  ReportInput input{.title = "A <script>alert(1)</script> flight",
                    .subtitle = "3 frames",
                    .frame = LocalFrame({8.5, 47.4}),
                    .frames = std::vector<FrameReport>(3),
                    .refined = std::vector<Estimate>(3),
                    .truth = Truth(3),
                    .score = {},
                    .integrity = {},
                    .figures = {{"frames", "3"}},
                    .worst = {},
                    .map = std::nullopt};
  input.frames[0].estimate.frame = "</script><img src=x>.jpg";
  input.frames[0].estimate.position = LonLat{8.5001, 47.4};
  input.frames[0].estimate.covariance_m2 << 4, 0, 0, 9;
  input.truth[0] = LonLat{8.5, 47.4};
  input.frames[1].anchor.verdict = AnchorVerdict::ambiguous;
  return input;
}

nlohmann::json data_of(const std::string& html) {
  const std::string open = "<script type=\"application/json\" id=\"data\">";
  const auto begin = html.find(open) + open.size();
  return nlohmann::json::parse(html.substr(begin, html.find("</script>", begin) - begin));
}

TEST(Report, ContainsTheFrames) {
  const auto data = data_of(report_html(small_input()));
  ASSERT_EQ(data["frames"].size(), 3U);
  EXPECT_NEAR(data["frames"][0]["east"].get<double>(), 7.55, 0.02);
  EXPECT_NEAR(data["frames"][0]["error"].get<double>(), 7.55, 0.02);
  EXPECT_EQ(data["frames"][1]["anchor"]["verdict"], "ambiguous");
  EXPECT_FALSE(data["frames"][1].contains("east"));
  EXPECT_TRUE(data["map"].is_null());
}

// A frame without a position has no accuracy either: the page shows "–", not "0.0 m".
TEST(Report, HasNoSigmaWithoutAPosition) {
  ReportInput input = small_input();
  input.frames[0].estimate.sigma_m = 2.5;
  const auto data = data_of(report_html(input));
  EXPECT_EQ(data["frames"][0]["sigma"], 2.5);
  EXPECT_TRUE(data["frames"][1]["sigma"].is_null());
}

TEST(Report, ShowsWhyNothingWasLocalized) {
  ReportInput input = small_input();
  EXPECT_EQ(data_of(report_html(input))["notice"], "");
  input.notice = "match at 0.30 × the stated height: <b>are the heights in feet?";
  EXPECT_EQ(data_of(report_html(input))["notice"], input.notice);
}

TEST(Report, ContainsTheProtectionLevelsAndTheRegionsOfTheStanfordDiagram) {
  ReportInput input = small_input();
  input.frames[0].estimate.hpl_m = 6;
  input.frames[1].estimate.hpl_m = 50;  // without a position
  input.integrity = integrity_figures({input.frames[0].estimate}, {input.truth[0]}, input.frame, 80);
  const auto data = data_of(report_html(input));
  EXPECT_EQ(data["frames"][0]["hpl"], 6);
  EXPECT_TRUE(data["frames"][1]["hpl"].is_null());
  EXPECT_TRUE(data["frames"][2]["hpl"].is_null());
  EXPECT_EQ(data["integrity"]["limit"], 80);
  EXPECT_EQ(data["integrity"]["counts"]["misleading"], 1) << "7.55 m off";
  EXPECT_EQ(data["integrity"]["counts"]["hazardously misleading"], 0);
  EXPECT_NE(report_html(input).find("id=\"stanford\""), std::string::npos);
}

TEST(Report, VectorsOnTheMapAreDrawnInItsPlane) {
  ReportInput input = small_input();
  const auto at = [&](double east_m, double north_m) { return input.frame.lonlat_from_plane({east_m, north_m}); };
  input.vectors =
      VectorLayer{"</script> contributors",
                  "ODbL-1.0",
                  {{VectorClass::road, "track", false, {{at(-500, 0), at(20, 10)}}},
                   {VectorClass::building, "yes", true, {{at(900, 0), at(910, 0), at(910, 9), at(900, 0)}}}}};
  EXPECT_FALSE(data_of(report_html(input)).contains("vectors")) << "without imagery there is nothing to draw them on";
  input.map = ReportMap{"data:,", -100, 100, 200, 200};
  const auto data = data_of(report_html(input));
  ASSERT_EQ(data["vectors"]["features"].size(), 1U) << "the building lies beside the map";
  EXPECT_EQ(data["vectors"]["attribution"], "</script> contributors");
  const auto& points = data["vectors"]["features"][0]["geometry"]["coordinates"];
  EXPECT_NEAR(points[1][0].get<double>(), 20, 0.06);
  EXPECT_NEAR(points[1][1].get<double>(), 10, 0.06);
}

TEST(Report, ExternalNamesAreEscaped) {
  const std::string html = report_html(small_input());
  EXPECT_EQ(html.find("<img src=x>"), std::string::npos);
  EXPECT_EQ(html.find("<script>alert"), std::string::npos);
  EXPECT_EQ(data_of(html)["frames"][0]["name"], "</script><img src=x>.jpg");
}

TEST(Report, LoadsNoExternalResources) {
  std::string html = report_html(small_input());
  const std::string_view link = "href=\"https://leafletjs.com\"";  // of Leaflet's attribution: nothing is loaded by it
  for (std::size_t at; (at = html.find(link)) != std::string::npos;) html.erase(at, link.size());
  for (const char* word : {"src=\"http", "href=\"http", "url(http", "@import", "fetch(", "XMLHttpRequest", "{{"}) {
    EXPECT_EQ(html.find(word), std::string::npos) << word;
  }
}

TEST(WorstFrames, KeepsTheWorstFramesInBoundedMemory) {
  WorstFrames worst(3);
  AnchorReport anchor;
  worst.offer(0, 1000, anchor);  // no pictures: nothing to show
  anchor.rectified = cv::Mat(20, 30, CV_8UC1, cv::Scalar(100));
  anchor.matched_map = cv::Mat(20, 30, CV_8UC3, cv::Scalar(100, 90, 80));
  for (const std::size_t i : {1U, 5U, 3U, 2U, 4U}) worst.offer(i, static_cast<double>(i), anchor);
  ASSERT_EQ(worst.worst_first().size(), 3U);
  EXPECT_EQ(worst.worst_first()[0].index, 5U);
  EXPECT_EQ(worst.worst_first()[2].index, 3U);
  EXPECT_THAT(worst.worst_first()[0].frame_uri, ::testing::StartsWith("data:image/jpeg;base64,/9j/"));
}

}  // namespace
}  // namespace nadir
