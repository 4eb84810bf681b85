#include "api/view_formats.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "api/flight_view.hpp"

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

TEST_F(EventStream, TellsEachEventOnceAndTheStateWhenItIsNew) {
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

TEST_F(EventStream, GoesOnWhereItBrokeOff) {
  for (const char* text : {"one", "two", "three"}) happen(text);
  StreamCursor cursor = cursor_from("b1-2");
  const std::string text = stream_text(view(), 0, cursor);
  EXPECT_THAT(text, Not(HasSubstr("\"two\"")));
  EXPECT_THAT(text, HasSubstr("\"three\""));
  EXPECT_THAT(text, Not(HasSubstr("event: missed")));
}

TEST_F(EventStream, SaysHowManyWereMissed) {
  for (int i = 1; i <= 20; ++i) happen(std::to_string(i));  // the ring holds 16 to 20
  StreamCursor cursor = cursor_from("b1-4");
  const std::string text = stream_text(view(), 0, cursor);
  EXPECT_THAT(text, HasSubstr("event: missed\ndata: {\"count\":11}\n\n"));
  EXPECT_EQ(count(text, "event: log\n"), 5);
}

TEST_F(EventStream, AnotherRunOfTheServiceStartsAfresh) {
  happen("one");
  for (const char* id :
       {"b0-1", "b1-7", "", "b1", "b1-", "b1-x", "-1", "b1-99999999999999999999999", "b1--1", "\r\nb1-1"}) {
    StreamCursor cursor = cursor_from(id);
    EXPECT_EQ(count(stream_text(view(), 0, cursor), "event: log\n"), 1) << id;
  }
}

// Text of an event cannot end its line and begin a message of its own.
TEST_F(EventStream, TextStaysInItsLine) {
  happen("harmless\n\nevent: state\ndata: {\"state\":\"normal\"}\r\n\r\n");
  FlightView hostile = view();
  hostile.boot_id = "b\n1: x";
  StreamCursor cursor;
  const std::string text = stream_text(hostile, 0, cursor);
  EXPECT_EQ(count(text, "\nevent: state\n"), 1);
  EXPECT_EQ(count(text, "\r"), 0);
  EXPECT_THAT(text, HasSubstr("id: b1x-1\n"));
}

}  // namespace
}  // namespace nadir
