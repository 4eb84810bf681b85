#include "api/view_formats.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <regex>
#include <set>
#include <sstream>

#include "api/scripted_flight.hpp"

namespace nadir {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// The grammar of the text format, line by line: HELP, TYPE, then samples of that name.
TEST(Metrics, FollowTheTextFormat) {
  test::ScriptedFlight flight;
  const std::string text = metrics_text(flight.at(100, ServiceState::normal), 0.1, {});
  const std::regex help("# HELP (nadir_[a-z_]+) .+"), type("# TYPE (nadir_[a-z_]+) (gauge|counter)");
  const std::regex sample(R"re((nadir_[a-z_]+)(\{[a-z]+="[^"\\]*"\})? [0-9.e+-]+)re");
  std::istringstream lines(text);
  std::smatch match;
  std::set<std::string> seen;
  std::string name;
  for (std::string line; std::getline(lines, line);) {
    if (std::regex_match(line, match, help)) {
      name = match[1];
      EXPECT_TRUE(seen.insert(name).second) << "twice: " << name;
    } else if (std::regex_match(line, match, type)) {
      EXPECT_EQ(match[1], name);
      EXPECT_EQ(match[2] == "counter", name.ends_with("_total")) << name;
    } else {
      ASSERT_TRUE(std::regex_match(line, match, sample)) << line;
      EXPECT_EQ(match[1], name);
    }
  }
  EXPECT_EQ(text.back(), '\n');
  EXPECT_THAT(text, HasSubstr("nadir_state{state=\"normal\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("nadir_state{state=\"no_fix\"} 0\n"));
  EXPECT_THAT(text, HasSubstr("nadir_position_sigma_meters 2.8\n"));
}

TEST(Metrics, WhatIsNotKnownIsAbsent) {
  const std::string text = metrics_text({}, 0, {});
  EXPECT_THAT(text, Not(HasSubstr("sigma")));
  EXPECT_THAT(text, Not(HasSubstr("nadir_anchor_age_seconds")));
}

TEST(Metrics, LabelsAreEscaped) {
  FlightView view;
  view.link.rejected_by["a\"b\\c\nd"] = 3;
  view.agl_m = std::numeric_limits<double>::quiet_NaN();
  const std::string text = metrics_text(view, 0, {});
  EXPECT_THAT(text, HasSubstr("nadir_link_frames_rejected_total{reason=\"a\\\"b\\\\c\\nd\"} 3\n"));
  EXPECT_THAT(text, HasSubstr("nadir_agl_meters NaN\n"));
}

}  // namespace
}  // namespace nadir
