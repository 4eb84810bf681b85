#include "api/view_formats.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "api/flight_view.hpp"
#include "api/scripted_flight.hpp"

namespace nadir {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class EventStream : public ::testing::Test {
 protected:
  FlightView view() {
    FlightView result;
    result.boot_id = "b1";
    result.version = ++version_;
    result.events = ring_.events();
    result.events_gone = ring_.gone();
    return result;
  }
  void happen(const std::string& text) { ring_.add(1, EventSeverity::info, "state", text); }

  EventRing ring_{5};
  std::uint64_t version_ = 0;
};

int count(const std::string& text, const std::string& word) {
  int found = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++found;
  return found;
}

TEST_F(EventStream, SendsEachEventOnceAndEveryNewState) {
  happen("one");
  StreamCursor cursor;
  const FlightView first = view();
  const std::string text = stream_text(first, 0, cursor);
  EXPECT_THAT(text, HasSubstr("id: b1-1\nevent: log\ndata: {"));
  EXPECT_EQ(count(text, "event: state\n"), 1);
  EXPECT_EQ(text.substr(text.size() - 2), "\n\n");
  EXPECT_EQ(stream_text(first, 0, cursor), "");
  const std::string next = stream_text(view(), 0, cursor);
  EXPECT_EQ(count(next, "event: log\n"), 0);
  EXPECT_EQ(count(next, "event: state\n"), 1);
}

TEST_F(EventStream, ResumesAfterTheLastEventReceived) {
  for (const char* text : {"one", "two", "three"}) happen(text);
  StreamCursor cursor = cursor_from("b1-2");
  const std::string text = stream_text(view(), 0, cursor);
  EXPECT_THAT(text, Not(HasSubstr("\"two\"")));
  EXPECT_THAT(text, HasSubstr("\"three\""));
  EXPECT_THAT(text, Not(HasSubstr("event: missed")));
}

TEST_F(EventStream, ReportsTheNumberOfMissedEvents) {
  for (int i = 1; i <= 20; ++i) happen(std::to_string(i));  // the ring holds 16 to 20
  StreamCursor cursor = cursor_from("b1-4");
  const std::string text = stream_text(view(), 0, cursor);
  EXPECT_THAT(text, HasSubstr("event: missed\ndata: {\"count\":11}\n\n"));
  EXPECT_EQ(count(text, "event: log\n"), 5);
}

// A repeat takes a new number, but the one that it replaced does not count as missed.
TEST_F(EventStream, ARepeatedEventIsSentAgainAndCountsAsNotMissed) {
  ring_ = EventRing(5, 300);
  happen("camera silent");
  happen("camera back");
  StreamCursor cursor;
  stream_text(view(), 0, cursor);
  for (int i = 0; i < 3; ++i) {
    happen("camera silent");
    happen("camera back");
  }
  const std::string text = stream_text(view(), 0, cursor);
  EXPECT_THAT(text, Not(HasSubstr("event: missed")));
  EXPECT_EQ(count(text, "event: log\n"), 2);
  EXPECT_THAT(text, HasSubstr("\"count\":4"));
}

// Ages keep growing when the flight's thread is silent.
TEST(StateJson, AgesAreAsOfNowNotOfTheView) {
  FlightView flight;
  flight.time_s = 100;
  flight.anchored_s = 97;
  flight.frames.last_s = 99.5;
  flight.link.last_message_s = 100;
  flight.state.since_s = 60;
  const FlightEvent event{.id = 1, .time_s = 90, .kind = "state", .text = "x"};
  const auto state = state_json(flight, 7);
  EXPECT_EQ(state["age_s"], 7);
  EXPECT_EQ(state["anchor_age_s"], 10);
  EXPECT_EQ(state["frames"]["age_s"], 7.5);
  EXPECT_EQ(state["link"]["age_s"], 7);
  EXPECT_EQ(state["state_for_s"], 47);
  EXPECT_EQ(event_json(event, flight, 7)["age_s"], 17);
  EXPECT_TRUE(state_json({}, 7)["anchor_age_s"].is_null());
}

TEST_F(EventStream, StartsOverAfterAServiceRestart) {
  happen("one");
  for (const char* id :
       {"b0-1", "b1-7", "", "b1", "b1-", "b1-x", "-1", "b1-99999999999999999999999", "b1--1", "\r\nb1-1"}) {
    StreamCursor cursor = cursor_from(id);
    EXPECT_EQ(count(stream_text(view(), 0, cursor), "event: log\n"), 1) << id;
  }
}

// The text of an event cannot end its line and start another message.
TEST_F(EventStream, KeepsTextOnOneLine) {
  happen("harmless\n\nevent: state\ndata: {\"state\":\"normal\"}\r\n\r\n");
  FlightView hostile = view();
  hostile.boot_id = "b\n1: x";
  StreamCursor cursor;
  const std::string text = stream_text(hostile, 0, cursor);
  EXPECT_EQ(count(text, "\nevent: state\n"), 1);
  EXPECT_EQ(count(text, "\r"), 0);
  EXPECT_THAT(text, HasSubstr("id: b1x-1\n"));
}

// The grammar of the text format, line by line: HELP, TYPE, then samples of that name.
TEST(Metrics, ConformToTheTextFormat) {
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
  EXPECT_THAT(text, HasSubstr("nadir_protection_level_metres 18.2"));
  EXPECT_THAT(text, HasSubstr("nadir_position_usable 1\n"));
}

TEST(Metrics, OmitUnknownValues) {
  const std::string text = metrics_text({}, 0, {});
  EXPECT_THAT(text, Not(HasSubstr("sigma")));
  EXPECT_THAT(text, Not(HasSubstr("nadir_protection_level_metres")));
  EXPECT_THAT(text, HasSubstr("nadir_position_usable 0\n"));
  EXPECT_THAT(text, Not(HasSubstr("nadir_anchor_age_seconds")));
}

// Texts of the autopilot, of the package and of files end up in views; none may look like a line of the service.
TEST(Views, ForgedLinesStayOnTheirLine) {
  const std::string forged = "gone\n12:00:00 state normal\xE2\x80\xA8";
  const std::string shown = "gone⏎12:00:00 state normal⏎";
  FlightView view;
  view.state.reason = view.gps.reason = view.recorder.reason = forged;
  view.link.rejected_by[forged] = 1;
  const auto state = state_json(view, 0);
  EXPECT_EQ(state["reason"], shown);
  EXPECT_EQ(state["gps"]["reason"], shown);
  EXPECT_EQ(state["recorder"]["reason"], shown);
  EXPECT_EQ(state["link"]["rejected_by"].begin().key(), shown);
  EventRing ring(1);
  ring.add(1, EventSeverity::info, "autopilot", forged);
  view.events = ring.events();
  EXPECT_EQ(event_json(view.events.back(), view, 0)["text"], shown);
  PackageView package;
  package.reason = package.mission = package.series = forged;
  for (const char* key : {"reason", "mission", "series"}) EXPECT_EQ(package_json(package)[key], shown) << key;
}

TEST(Metrics, LabelsAreEscaped) {
  FlightView view;
  view.link.rejected_by["a\"b\\c\nd"] = 3;
  view.agl_m = std::numeric_limits<double>::quiet_NaN();
  const std::string text = metrics_text(view, 0, {});
  EXPECT_THAT(text, HasSubstr("nadir_link_frames_rejected_total{reason=\"a\\\"b\\\\c⏎d\"} 3\n"));
  EXPECT_THAT(text, HasSubstr("nadir_agl_meters NaN\n"));
}

}  // namespace
}  // namespace nadir
