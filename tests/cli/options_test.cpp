#include "cli/options.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "base/error.hpp"
#include "cli/help_text.hpp"

namespace nadir {
namespace {

struct Values {
  std::filesystem::path mission;
  std::vector<std::filesystem::path> imagery;
  int quality = 85;
  std::string format = "mbtiles";
  std::optional<LonLat> start;
  std::optional<UtcTime> at;
  std::optional<std::int64_t> seed;
  bool force = false;
};

Values parse(const std::vector<std::string>& args) {
  Values values;
  Options options("nadir t");
  options.positional("MISSION.yaml", values.mission, "the mission");
  options.values("--imagery", values.imagery, "FILE", "rasters");
  options.value("--quality", values.quality, "N", "JPEG quality").between(1, 100);
  options.value("--format", values.format, "NAME", "container").one_of({"mbtiles", "cog"});
  options.value("--start", values.start, "LON,LAT", "start").needs("--at");
  options.value("--at", values.at, "TIME", "time");
  options.value("--seed", values.seed, "N", "seed");
  options.flag("--force", values.force, "force");
  options.parse(args);
  return values;
}

std::string complaint(const std::vector<std::string>& args) {
  try {
    parse(args);
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

TEST(Options, APlaceMayBeAGridReference) {
  const Values values = parse({"m.yaml", "--at", "2024-10-30", "--start", "18S UJ 22821 06997"});
  ASSERT_TRUE(values.start);
  EXPECT_NEAR(values.start->lon_deg, -77.043, 2e-5);
  EXPECT_NEAR(values.start->lat_deg, 38.894, 1e-5);
  EXPECT_NE(complaint({"m.yaml", "--at", "2024-10-30", "--start", "18SUJ"}).find("1 km or less"), std::string::npos)
      << "a square of 100 km is no place";
}

TEST(Options, DefaultsStay) {
  const Values values = parse({});
  EXPECT_EQ(values.quality, 85);
  EXPECT_FALSE(values.seed.has_value());
  EXPECT_FALSE(values.force);
}

TEST(Options, ReadsEveryType) {
  const Values values = parse({"m.yaml", "--imagery", "a.tif", "b.tif", "--quality=70", "--format", "cog", "--at",
                               "2024-10-30", "--start", "-83.30572,41.03467", "--seed", "-7", "--force"});
  EXPECT_EQ(values.mission, "m.yaml");
  EXPECT_EQ(values.imagery.size(), 2U);
  EXPECT_EQ(values.quality, 70);
  EXPECT_EQ(values.format, "cog");
  ASSERT_TRUE(values.start.has_value());
  EXPECT_EQ(*values.start, (LonLat{-83.30572, 41.03467}));
  EXPECT_EQ(to_rfc3339(*values.at), "2024-10-30T00:00:00Z");
  EXPECT_EQ(values.seed, -7);
  EXPECT_TRUE(values.force);
}

TEST(Options, ManyValuesMayRepeatTheName) {
  EXPECT_EQ(parse({"--imagery", "a", "--imagery", "b", "--force"}).imagery.size(), 2U);
}

TEST(Options, NamesTheOptionWithAnInvalidValue) {
  EXPECT_THAT(complaint({"--quality", "high"}),
              ::testing::AllOf(::testing::HasSubstr("--quality"), ::testing::HasSubstr("high")));
  EXPECT_THAT(complaint({"--quality", "101"}), ::testing::HasSubstr("1 to 100"));
  EXPECT_THAT(complaint({"--format", "zip"}), ::testing::HasSubstr("mbtiles, cog"));
  EXPECT_THAT(complaint({"--at", "2024-02-30"}), ::testing::HasSubstr("--at"));
  for (const char* bad : {"1", "1,", ",1", "181,0", "0,91", "nan,0", "1;2", "1,2,3"}) {
    EXPECT_NE(complaint({"--at", "2024-01-01", "--start", bad}), "") << bad;
  }
}

TEST(Options, RejectsWrongUsage) {
  EXPECT_NE(complaint({"--quality", "1", "--quality", "2"}), "");
  EXPECT_NE(complaint({"--quality"}), "");
  EXPECT_NE(complaint({"a.yaml", "b.yaml"}), "");
  EXPECT_NE(complaint({"--force=yes=no"}), "");
  EXPECT_THAT(complaint({"--start", "1,2"}), ::testing::HasSubstr("--at"));
  EXPECT_NE(complaint({"-x"}), "");
}

TEST(Options, AnOldSpellingStillWorksButIsNotShown) {
  for (const std::vector<std::string>& args :
       {std::vector<std::string>{"--gsd-m", "0.5"}, {"--gsd", "0.5"}, {"--gsd-m=0.5"}, {"--gsd=0.5"}}) {
    double gsd_m = 0;
    Options options("nadir t");
    options.value("--gsd-m", gsd_m, "METRES", "resolution").required().between(0.1, 10).formerly("--gsd");
    EXPECT_TRUE(options.parse(args));
    EXPECT_EQ(gsd_m, 0.5);
    std::ostringstream help;
    options.print_help(help, "", "", "");
    EXPECT_THAT(help.str(), ::testing::Not(::testing::ContainsRegex("--gsd[^-]")));
  }
}

TEST(Options, ParagraphsOfHelpAreFilledAndTablesStay) {
  const std::string lines = std::string(60, 'a') + "\n" + std::string(30, 'b') + "\n" + std::string(60, 'c');
  EXPECT_EQ(filled(lines + "\n\nsecond\nparagraph", 0),
            std::string(60, 'a') + " " + std::string(30, 'b') + "\n" + std::string(60, 'c') + "\n\nsecond paragraph");
  EXPECT_EQ(filled("a word", 4), "a word");
  EXPECT_EQ(filled(std::string(90, 'a') + " " + std::string(10, 'b'), 4),
            std::string(90, 'a') + "\n    " + std::string(10, 'b'));
  EXPECT_EQ(filled("  0  replayed\n  1  rejected", 2), "  0  replayed\n    1  rejected");
  EXPECT_EQ(filled("\u2026 " + std::string(98, 'a'), 0), "\u2026 " + std::string(98, 'a')) << "columns, not bytes";
  EXPECT_EQ(filled("", 3), "");
}

TEST(Options, NearestWordIsCareful) {
  EXPECT_EQ(nearest_word("--telemtry", {"--telemetry", "--truth"}), "--telemetry");
  EXPECT_EQ(nearest_word("xyz", {"keys", "cache"}), "");
}

// As `cache build` with --plan: another way to call it.
TEST(Options, AnAlternativeNeedsNothingElseAndAllowsNothingElse) {
  const auto complaint_of = [](const std::vector<std::string>& args) -> std::string {
    std::string mission, out, plan, shard;
    Options options("nadir t");
    options.value("--mission", mission, "FILE", "mission").required();
    options.value("--out", out, "FOLDER", "output").required();
    options.value("--plan", plan, "PLAN", "plan").needs("--shard");
    options.value("--shard", shard, "I/N", "shard").needs("--plan");
    options.alternative("--plan", {"--shard", "--out"});
    try {
      options.parse(args);
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(complaint_of({"--mission", "m", "--out", "o"}), "");
  EXPECT_EQ(complaint_of({"--plan", "p", "--shard", "1/2"}), "");
  EXPECT_EQ(complaint_of({"--plan=p", "--shard", "1/2", "--out", "o"}), "");
  EXPECT_THAT(complaint_of({"--out", "o"}), testing::HasSubstr("--mission FILE is required"));
  EXPECT_THAT(complaint_of({"--plan", "p", "--shard", "1/2", "--mission", "m"}),
              testing::HasSubstr("--mission cannot be given with --plan"));
  EXPECT_THAT(complaint_of({"--plan", "p"}), testing::HasSubstr("--shard"));
  EXPECT_THAT(complaint_of({"--mission", "m", "--out", "o", "--shard", "1/2"}), testing::HasSubstr("--plan"));
}

}  // namespace
}  // namespace nadir
