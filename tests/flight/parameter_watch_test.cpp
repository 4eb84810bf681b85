#include "flight/parameter_watch.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <deque>
#include <map>
#include <set>

namespace nadir {
namespace {

constexpr MavlinkAddress kWatchedAutopilot{1, 1};
constexpr std::uint8_t kParamInt32 = 6, kReal32 = 9;
constexpr Heartbeat kDisarmed{.is_autopilot = true, .autopilot = AutopilotType::px4};
constexpr Heartbeat kArmed{.is_autopilot = true, .autopilot = AutopilotType::px4, .armed = true};
constexpr std::uint32_t k1_16 = 0x011000FF, k1_18 = 0x011200FF;

ParameterValue px4_int(const std::string& name, double value) {
  return {.name = name, .wire_value = wire_value(value, kParamInt32, ParameterEncoding::bytewise), .type = kParamInt32};
}

TEST(ParameterWatch, AsksForAllOfThemWhileDisarmed) {
  ParameterWatch watch({{"A", 1}, {"B", 2}, {"C", 3}, {"D", 4}}, kWatchedAutopilot);
  std::multiset<std::string> asked;
  for (int beat = 0; beat < 4; ++beat) {
    for (const OutgoingMessage& request : watch.on_heartbeat(beat, kDisarmed).requests) {
      EXPECT_EQ(std::get<ParameterRequest>(request).target, kWatchedAutopilot);
      asked.insert(std::get<ParameterRequest>(request).name);
    }
  }
  for (const char* name : {"A", "B", "C", "D"}) EXPECT_EQ(asked.count(name), 3U) << "again and again";
  for (const char* name : {"A", "B", "D"}) static_cast<void>(watch.on_message(px4_int(name, 1)));
  std::set<std::string> in_flight;
  for (int beat = 4; beat < 8; ++beat) {
    for (const OutgoingMessage& request : watch.on_heartbeat(beat, kArmed).requests) {
      in_flight.insert(std::get<ParameterRequest>(request).name);
    }
  }
  EXPECT_THAT(in_flight, testing::ElementsAre("C")) << "what is not known yet";
  static_cast<void>(watch.on_message(px4_int("C", 3)));
  EXPECT_TRUE(watch.on_heartbeat(8, kArmed).requests.empty());
}

TEST(ParameterWatch, WithNothingExpectedNothingIsAsked) {
  ParameterWatch watch({}, kWatchedAutopilot);
  for (int beat = 0; beat < 100; ++beat) {
    const ParameterWatch::Turn turn = watch.on_heartbeat(beat, kDisarmed);
    EXPECT_TRUE(turn.requests.empty() && !turn.missing);
  }
  EXPECT_FALSE(watch.on_message(AutopilotVersion{.flight_software = k1_16}));
  EXPECT_EQ(watch.check(), ParameterCheck::none_listed);
}

// An autopilot that has these parameters, and answers each request after some heartbeats.
class WatchedFlight {
 public:
  explicit WatchedFlight(std::vector<AirframeParameter> listed) : watch(listed, kWatchedAutopilot) {
    for (const AirframeParameter& one : listed) has[one.name] = one.value;
  }

  // A second, with a heartbeat, unless the link is lost.
  void beat(const Heartbeat& heartbeat = kDisarmed) {
    now_s += 1;
    ++beats;
    if (lost) return;
    ParameterWatch::Turn turn = watch.on_heartbeat(now_s, heartbeat);
    if (turn.missing) missing.push_back(*turn.missing);
    for (const OutgoingMessage& request : turn.requests) {
      if (std::holds_alternative<CommandLong>(request)) ++versions_asked;
      if (const auto* one = std::get_if<ParameterRequest>(&request)) asked_.push_back({beats, one->name});
    }
    for (; !asked_.empty() && asked_.front().first + late <= beats; asked_.pop_front()) {
      const auto one = has.find(asked_.front().second);
      if (one == has.end()) continue;
      if (const auto changed = watch.on_message(px4_int(one->first, one->second))) changes.push_back(*changed);
    }
  }
  void beat_times(int times) {
    for (int i = 0; i < times; ++i) beat();
  }

  ParameterWatch watch;
  std::map<std::string, double> has;
  int late = 0, beats = 0, versions_asked = 0;
  bool lost = false;
  double now_s = 0;
  std::vector<ParametersMissing> missing;
  std::vector<ParameterChanged> changes;

 private:
  std::deque<std::pair<int, std::string>> asked_;
};

const std::vector<AirframeParameter> kGlobalPosition{
    {"EKF2_AGP0_ID", 1},  {"EKF2_AGP0_CTRL", 1}, {"EKF2_AGP0_MODE", 0}, {"EKF2_AGP0_GATE", 5},
    {"EKF2_SENS_EN", 16}, {"EKF2_HGT_REF", 0},   {"EKF2_GPS_CTRL", 7}};

TEST(ParameterWatch, AParameterThatTheAutopilotNoLongerHasIsMissing) {
  WatchedFlight flight({{"GPS1_TYPE", 14}, {"GPS1_DELAY_MS", 10}, {"EK3_SRC1_POSXY", 3}, {"EK3_SRC1_YAW", 1}});
  flight.beat_times(2);
  EXPECT_EQ(flight.watch.check(), ParameterCheck::as_provisioned);
  flight.has.erase("GPS1_DELAY_MS");
  flight.has.erase("EK3_SRC1_YAW");
  flight.beat_times(30);
  ASSERT_EQ(flight.missing.size(), 1U) << "once, and both together";
  EXPECT_THAT(flight.missing[0].names, testing::ElementsAre("GPS1_DELAY_MS", "EK3_SRC1_YAW"));
  EXPECT_FALSE(flight.missing[0].all);
  EXPECT_EQ(flight.watch.check(), ParameterCheck::deviating);
  flight.has = {{"GPS1_TYPE", 14}, {"GPS1_DELAY_MS", 10}, {"EK3_SRC1_POSXY", 3}, {"EK3_SRC1_YAW", 1}};
  flight.beat_times(4);
  ASSERT_EQ(flight.changes.size(), 2U);
  EXPECT_TRUE(flight.changes[0].restored() && flight.changes[1].restored());
  EXPECT_EQ(flight.watch.check(), ParameterCheck::as_provisioned);
}

TEST(ParameterWatch, AnAutopilotThatAnswersLateOrAfterALostLinkHasThemAll) {
  for (const int late : {1, 5, 20}) {
    WatchedFlight flight(kGlobalPosition);
    flight.late = late;
    EXPECT_FALSE(flight.watch.on_message(AutopilotVersion{.flight_software = k1_18}));
    for (int i = 0; i < 10; ++i) {
      flight.beat_times(40);
      flight.lost = true;
      flight.beat_times(30);
      flight.lost = false;
    }
    flight.beat_times(25);
    EXPECT_TRUE(flight.missing.empty()) << late;
    EXPECT_TRUE(flight.changes.empty());
    EXPECT_EQ(flight.watch.check(), ParameterCheck::as_provisioned);
  }
}

// Each third answer is lost.
TEST(ParameterWatch, AnAnswerThatIsLostNowAndThenIsAskedForAgain) {
  ParameterWatch watch(kGlobalPosition, kWatchedAutopilot);
  int answers = 0;
  for (int beat = 0; beat < 600; ++beat) {
    const ParameterWatch::Turn turn = watch.on_heartbeat(beat, kDisarmed);
    EXPECT_FALSE(turn.missing) << beat;
    for (const OutgoingMessage& request : turn.requests) {
      const auto* one = std::get_if<ParameterRequest>(&request);
      if (one == nullptr || ++answers % 3 == 0) continue;
      const auto listed = std::ranges::find(kGlobalPosition, one->name, &AirframeParameter::name);
      EXPECT_FALSE(watch.on_message(px4_int(one->name, listed->value)));
    }
  }
}

TEST(ParameterWatch, AnAutopilotThatAnswersNothingForAMinuteHasNone) {
  WatchedFlight flight({{"GPS1_TYPE", 14}, {"EK3_SRC1_YAW", 1}});
  flight.has.clear();
  flight.beat_times(59);
  EXPECT_TRUE(flight.missing.empty());
  EXPECT_EQ(flight.watch.check(), ParameterCheck::pending);
  flight.beat_times(30);
  ASSERT_EQ(flight.missing.size(), 1U);
  EXPECT_TRUE(flight.missing[0].all);
  EXPECT_EQ(flight.missing[0].names.size(), 2U);
  EXPECT_EQ(flight.watch.check(), ParameterCheck::deviating);
}

// PX4 is replaced by a version that has other parameters, while this program runs.
TEST(ParameterWatch, AnUpdateAcross118IsReportedOnceAndNotEachParameter) {
  WatchedFlight flight(kGlobalPosition);
  flight.beat_times(3);
  EXPECT_EQ(flight.versions_asked, 3);
  EXPECT_EQ(flight.watch.check(), ParameterCheck::pending) << "the version is not known";
  EXPECT_FALSE(flight.watch.on_message(AutopilotVersion{.flight_software = k1_18}));
  EXPECT_EQ(flight.watch.check(), ParameterCheck::as_provisioned);
  flight.beat_times(20);
  EXPECT_GE(flight.versions_asked, 4) << "now and then";
  EXPECT_LE(flight.versions_asked, 6);

  flight.has = {{"EKF2_HGT_REF", 0}, {"EKF2_GPS_CTRL", 7}};
  const auto older = flight.watch.on_message(AutopilotVersion{.flight_software = k1_16});
  ASSERT_TRUE(older);
  EXPECT_EQ(older->version, "1.16.0");
  EXPECT_EQ(older->expected, "1.18 or later");
  EXPECT_FALSE(older->as_expected);
  EXPECT_FALSE(flight.watch.on_message(AutopilotVersion{.flight_software = k1_16})) << "once";
  flight.beat_times(100);
  EXPECT_TRUE(flight.missing.empty());
  EXPECT_EQ(flight.watch.check(), ParameterCheck::deviating);

  const auto back = flight.watch.on_message(AutopilotVersion{.flight_software = k1_18});
  ASSERT_TRUE(back);
  EXPECT_TRUE(back->as_expected);
  flight.beat_times(100);
  ASSERT_EQ(flight.missing.size(), 1U) << "a 1.18 without them";
  EXPECT_THAT(flight.missing[0].names, testing::Contains("EKF2_AGP0_CTRL"));
}

TEST(ParameterWatch, AnUpdateTo118IsReportedToo) {
  ParameterWatch watch({{"EKF2_EV_CTRL", 1}, {"EKF2_HGT_REF", 0}}, kWatchedAutopilot);
  const auto newer = watch.on_message(AutopilotVersion{.flight_software = k1_18});
  ASSERT_TRUE(newer);
  EXPECT_EQ(newer->version, "1.18.0");
  EXPECT_EQ(newer->expected, "earlier than 1.18");
  EXPECT_EQ(watch.check(), ParameterCheck::deviating);
}

TEST(ParameterWatch, WhatWeSetOurselvesIsNoDifference) {
  ParameterWatch watch({{"EKF2_GPS_CTRL", 7}}, kWatchedAutopilot);
  static_cast<void>(watch.on_heartbeat(1, kDisarmed));
  EXPECT_FALSE(watch.on_message(px4_int("EKF2_GPS_CTRL", 0), true));
  EXPECT_EQ(watch.check(), ParameterCheck::as_provisioned);
  EXPECT_FALSE(watch.on_message(px4_int("EKF2_GPS_CTRL", 7)));
  EXPECT_TRUE(watch.on_message(px4_int("EKF2_GPS_CTRL", 0))) << "somebody else";
}

TEST(ParameterWatch, ReportsEachDifferenceOnceAndItsEnd) {
  ParameterWatch watch({{"EKF2_AGP0_CTRL", 1}, {"EKF2_AGP0_GATE", 5.1}}, kWatchedAutopilot);
  static_cast<void>(watch.on_heartbeat(0, kDisarmed));
  EXPECT_FALSE(watch.on_message(px4_int("EKF2_AGP0_CTRL", 1)));
  EXPECT_FALSE(watch.on_message({.name = "EKF2_AGP0_GATE", .wire_value = 5.1F, .type = kReal32})) << "single precision";
  const auto changed = watch.on_message(px4_int("EKF2_AGP0_CTRL", 0));
  ASSERT_TRUE(changed);
  EXPECT_EQ(changed->name, "EKF2_AGP0_CTRL");
  EXPECT_EQ(changed->expected, 1);
  EXPECT_EQ(changed->found, 0);
  EXPECT_FALSE(watch.on_message(px4_int("EKF2_AGP0_CTRL", 0)));
  EXPECT_TRUE(watch.on_message(px4_int("EKF2_AGP0_CTRL", 2)));
  const auto restored = watch.on_message(px4_int("EKF2_AGP0_CTRL", 1));
  ASSERT_TRUE(restored);
  EXPECT_TRUE(restored->restored());
  EXPECT_FALSE(watch.on_message(px4_int("EKF2_AGP0_CTRL", 1)));
  EXPECT_FALSE(watch.on_message(px4_int("ANOTHER", 0)));
}

TEST(ParameterWatch, ArduPilotsIntegersAreNumbers) {
  ParameterWatch watch({{"GPS1_TYPE", 14}}, kWatchedAutopilot);
  static_cast<void>(watch.on_heartbeat(0, {.is_autopilot = true, .autopilot = AutopilotType::ardupilot}));
  EXPECT_FALSE(watch.on_message({.name = "GPS1_TYPE", .wire_value = 14, .type = 2}));
  EXPECT_TRUE(watch.on_message({.name = "GPS1_TYPE", .wire_value = 1, .type = 2}));
}

}  // namespace
}  // namespace nadir
