#include "flight/flight_journal.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <utility>
#include <vector>

namespace nadir {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

struct Operator {
  std::vector<std::pair<TextSeverity, std::string>> delivered;
  void collect(OperatorTexts& texts) {
    texts.deliver([this](TextSeverity severity, const std::string& text) { delivered.emplace_back(severity, text); });
  }
};

// A client that sends hints can fill the list of events, but cannot hide an alarm.
TEST(FlightJournal, OrdinaryEventsDisplaceNoAlarm) {
  FlightJournal journal(nullptr);
  journal.on_event(1, TileCorrupt{{17, 70000, 45000}, "artifact.hash", "bytes that differ from the signed ones"});
  for (int i = 0; i < 500; ++i) {
    journal.note(2 + i, EventSeverity::info, "hint", "hint " + std::string(static_cast<std::size_t>(i), 'x'));
  }
  EXPECT_EQ(journal.events().events().size(), 100);
  EXPECT_EQ(journal.events().events().front().kind, "hint");
  ASSERT_EQ(journal.alarms().events().size(), 1);
  EXPECT_EQ(journal.alarms().events().front().text,
            "artifact.hash: tile 17/70000/45000: bytes that differ from the signed ones; the map has a hole there");
}

TEST(FlightJournal, ReportsTheFirstFailedMatchOfARowAndItsEnd) {
  FlightJournal journal(nullptr);
  const auto texts = [&] {
    std::vector<std::string> all;
    for (const FlightEvent& event : journal.events().events()) all.push_back(event.text);
    return all;
  };
  for (int i = 0; i < 3; ++i) journal.on_event(i, MatchFailed{"insufficient memory"});
  EXPECT_THAT(texts(), ElementsAre("matching to the map failed: insufficient memory"));
  LocalizedFrame match;
  match.late = true;
  journal.on_event(4, match);
  EXPECT_EQ(texts().size(), 1) << "it came back without a result: it was the failed one";
  match.report.anchor.verdict = AnchorVerdict::ambiguous;
  journal.on_event(5, match);
  journal.on_event(6, match);
  EXPECT_THAT(texts(), ElementsAre(testing::_, "matching to the map works again"));
}

TEST(FlightJournal, SaysWhichParametersAreMissingAndWhatToDo) {
  FlightJournal journal(nullptr);
  journal.on_event(1, ParametersMissing{{"EKF2_AGP0_CTRL", "EKF2_AGP0_ID"}});
  journal.on_event(2, AutopilotVersionChanged{.version = "1.16.0", .expected = "1.18 or later"});
  std::vector<std::string> alarms;
  for (const FlightEvent& event : journal.alarms().events()) alarms.push_back(event.text);
  EXPECT_THAT(alarms,
              ElementsAre("EKF2_AGP0_CTRL, EKF2_AGP0_ID: the autopilot does not answer, and answers for others; it "
                          "was provisioned with them: provision again",
                          "PX4 is 1.16.0; it was provisioned as 1.18 or later, which takes our position by other "
                          "parameters: provision again"));
  journal.on_event(3, AutopilotVersionChanged{.version = "1.18.0", .expected = "1.18 or later", .as_expected = true});
  EXPECT_EQ(journal.alarms().events().size(), 2);
}

TEST(OperatorTexts, WaitInOrderAndAreDeliveredOnce) {
  OperatorTexts texts;
  texts.add(TextSeverity::critical, "lost");
  texts.add(TextSeverity::notice, "found");
  EXPECT_EQ(texts.pending(), 2);
  Operator first;
  first.collect(texts);
  EXPECT_THAT(first.delivered, ElementsAre(Pair(TextSeverity::critical, "lost"), Pair(TextSeverity::notice, "found")));
  EXPECT_EQ(texts.pending(), 0);
  EXPECT_EQ(texts.dropped(), 0);
  Operator later;
  later.collect(texts);
  EXPECT_THAT(later.delivered, IsEmpty());
  texts.add(TextSeverity::info, "link is back");
  later.collect(texts);
  EXPECT_THAT(later.delivered, ElementsAre(Pair(TextSeverity::info, "link is back")));
}

TEST(OperatorTexts, TheOldestAreDroppedAndCounted) {
  OperatorTexts texts(3);
  for (const char* text : {"1", "2", "3", "4", "5"}) texts.add(TextSeverity::info, text);
  EXPECT_EQ(texts.pending(), 3);
  EXPECT_EQ(texts.dropped(), 2);
  Operator late;
  late.collect(texts);
  EXPECT_THAT(late.delivered, ElementsAre(Pair(testing::_, "3"), Pair(testing::_, "4"), Pair(testing::_, "5")));
  texts.add(TextSeverity::info, "6");
  EXPECT_EQ(texts.pending(), 1) << "there is room again";
  EXPECT_EQ(texts.dropped(), 2);
}

TEST(OperatorTexts, AMillionUndeliveredTextsCostNoMoreThanTwelve) {
  OperatorTexts texts;
  for (int i = 0; i < 1'000'000; ++i) texts.add(TextSeverity::warning, "dead reckoning");
  EXPECT_EQ(texts.pending(), 12) << "as in docs/onboard.md";
  EXPECT_EQ(texts.dropped(), 999'988);
}

TEST(OperatorTexts, EmptyTextsAreIgnored) {
  OperatorTexts texts;
  texts.add(TextSeverity::info, "");
  EXPECT_EQ(texts.pending(), 0);
  EXPECT_EQ(texts.dropped(), 0);
}

TEST(OperatorTexts, TextsAddedDuringDeliveryWaitForTheNext) {
  OperatorTexts texts(1);
  texts.add(TextSeverity::info, "first");
  std::vector<std::string> delivered;
  const auto collect = [&](TextSeverity severity, const std::string& text) {
    delivered.push_back(text);
    if (text == "first") texts.add(severity, "second");
  };
  texts.deliver(collect);
  EXPECT_THAT(delivered, ElementsAre("first"));
  texts.deliver(collect);
  EXPECT_THAT(delivered, ElementsAre("first", "second"));
}

}  // namespace
}  // namespace nadir
