#include "cli/output.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "cli/command.hpp"

namespace nadir {
namespace {

Findings two_findings() {
  Findings findings;
  findings.add({.code = "freshness.stale", .severity = Severity::warning, .where = "19/1/2"});
  findings.add({.code = "coverage.gap", .where = "town", .expected = "all", .found = "a hole", .fix = "more imagery"});
  return findings;
}

TEST(Output, TextListsErrorsFirstAndCounts) {
  std::ostringstream out;
  EXPECT_EQ(report_findings(out, false, two_findings()), kRefused);
  EXPECT_LT(out.str().find("coverage.gap"), out.str().find("freshness.stale"));
  EXPECT_THAT(out.str(), ::testing::EndsWith("REJECTED: 1 error, 1 warning\n"));
}

TEST(Output, NothingFoundIsAccepted) {
  std::ostringstream out;
  EXPECT_EQ(report_findings(out, false, {}), kAccepted);
  EXPECT_EQ(out.str(), "accepted\n");
}

TEST(Output, JsonHoldsEveryField) {
  std::ostringstream out;
  EXPECT_EQ(report_findings(out, true, two_findings(), {{"package", "p"}}), kRefused);
  const auto document = nlohmann::json::parse(out.str());
  EXPECT_EQ(document["accepted"], false);
  EXPECT_EQ(document["package"], "p");
  ASSERT_EQ(document["findings"].size(), 2U);
  const nlohmann::json expected = {{"code", "coverage.gap"}, {"severity", "refuse"}, {"where", "town"},
                                   {"expected", "all"},      {"found", "a hole"},    {"fix", "more imagery"}};
  EXPECT_EQ(document["findings"][1], expected);
}

TEST(Output, WarningsAloneAreAccepted) {
  std::ostringstream out;
  Findings findings;
  findings.add({.code = "freshness.stale", .severity = Severity::warning, .where = "19/1/2"});
  EXPECT_EQ(report_findings(out, false, findings), kAccepted);
  EXPECT_THAT(out.str(), ::testing::EndsWith("accepted, 1 warning\n"));
}

TEST(Output, CountsInSingularAndPlural) {
  EXPECT_EQ(count(1, "sector"), "1 sector");
  EXPECT_EQ(count(0, "sector"), "0 sectors");
  EXPECT_EQ(count(2, "batch", "batches"), "2 batches");
}

TEST(Output, FiguresAreAlignedInColumns) {
  std::ostringstream out;
  print_figures(out, {{"a", "1"}, {"long", "2"}});
  EXPECT_EQ(out.str(), "a     1\nlong  2\n");
}

// An airframe's id from a recording, a package's name: quoted text cannot add a line.
TEST(Output, ForgedLinesAreNoFigures) {
  std::ostringstream out;
  print_figures(out, {{"airframe", "falcon\nsigned    yes\x1b[2J"}, {"lo\nng", "2"}});
  EXPECT_EQ(out.str(), "airframe  falcon⏎signed    yes?[2J\nlo⏎ng   2\n");
}

TEST(Output, ForgedLinesAreNoFindings) {
  std::ostringstream out;
  Findings findings;
  findings.add({.code = "tile.size", .where = "a\naccepted\n"});
  report_findings(out, false, findings);
  EXPECT_EQ(out.str(), "tile.size (error)\n  where:    a⏎accepted⏎\nREJECTED: 1 error\n");
}

}  // namespace
}  // namespace nadir
