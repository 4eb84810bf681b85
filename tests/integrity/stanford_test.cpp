// Protection levels against errors: what is counted, and what is kept of a simulated flight.
#include "bench/stanford.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "bench/safety_record.hpp"

namespace nadir::bench {
namespace {

const std::vector<LeveledError> kLevels = {{2, 20}, {5, 25}, {50, 80}, {40, 30}, {150, 90}, {10, 400}};

TEST(Stanford, CountsTheRegionsAmongAllPositions) {
  const LevelFigures figures = level_figures(10, kLevels);  // four had no level
  EXPECT_EQ(figures.below_30.count, 3);
  EXPECT_EQ(figures.usable.count, 5);
  EXPECT_EQ(figures.usable.of, 10);
  EXPECT_EQ(figures.misleading.count, 2);
  EXPECT_EQ(figures.hazardous.count, 1);
  EXPECT_DOUBLE_EQ(figures.least_ratio, 0.6);
  EXPECT_DOUBLE_EQ(figures.ratio_95, 10);
  EXPECT_THAT(level_row("nominal", figures), testing::HasSubstr("| nominal | 10 | 30.0 | 50.0 | 2 (2.5 to 56 %) |"));
}

TEST(Stanford, WithoutLevelsNothingIsUsableAndNothingMisleads) {
  const LevelFigures figures = level_figures(10, {});
  EXPECT_EQ(figures.usable.count, 0);
  EXPECT_EQ(figures.misleading.count, 0);
  EXPECT_THAT(level_row("black", figures), testing::HasSubstr("| - | - |"));
  EXPECT_THAT(level_row("none", level_figures(0, {})), testing::HasSubstr("| none | 0 | - |"));
}

TEST(Stanford, TheDrawingStatesTheCounts) {
  const std::string svg = stanford_svg("flights", kLevels);
  EXPECT_THAT(svg, testing::HasSubstr(">available 3<"));
  EXPECT_THAT(svg, testing::HasSubstr(">misleading 1<"));
  EXPECT_THAT(svg, testing::HasSubstr(">unavailable 1<"));
}

TEST(Stanford, ACellOfLevelsComesBackAsItWas) {
  EXPECT_EQ(levels_text(levels_of("2.00/20.00 5.00/25.00")), "2.00/20.00 5.00/25.00");
  EXPECT_TRUE(levels_of("").empty());
  for (const char* bad : {"2.00", "2.00/", "2/20x", "-1/20", "1/0", "2.00/20.00,5"}) {
    EXPECT_THROW(levels_of(bad), Error) << bad;
  }
}

TEST(SafetyRecord, KeepsTheLevelsOfASegment) {
  Record record;
  record.condition = "nominal";
  record.positioned = 10;
  record.levels = kLevels;
  const Record back = record_of(line(record));
  EXPECT_EQ(line(back), line(record));
  EXPECT_EQ(back.levels.size(), kLevels.size());
  record.levels.clear();
  EXPECT_TRUE(record_of(line(record)).levels.empty());
}

TEST(SafetyRecord, ALineOfAnOlderRunOrAPartOfOneIsAnError) {
  Record record;
  record.condition = "nominal";
  const std::string text = line(record);
  EXPECT_THROW(record_of(text.substr(0, text.rfind(','))), Error) << "without the last column";
  EXPECT_THROW(record_of(text.substr(0, text.size() / 2)), Error);
}

TEST(SafetyRecord, LevelsAreSummedUpByCondition) {
  std::map<std::uint64_t, Record> records;
  for (std::uint64_t i = 0; i < 4; ++i) {
    records[i].condition = i % 2 == 0 ? "nominal" : "clouds";
    records[i].positioned = 6;
    records[i].levels = {{1, 20}};
  }
  const std::string table = level_summary(records);
  EXPECT_THAT(table, testing::HasSubstr("| nominal | 12 | 16.7 |"));
  EXPECT_THAT(table, testing::HasSubstr("| clouds | 12 |"));
  EXPECT_THAT(table, testing::HasSubstr("| **all** | 24 |"));
  EXPECT_EQ(all_levels(records).size(), 4U);
}

}  // namespace
}  // namespace nadir::bench
