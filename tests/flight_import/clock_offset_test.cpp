// The offset between the clocks of camera and log: found where something determines it, and refused where not.
#include "flight_import/clock_offset.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "base/random.hpp"
#include "flight_import/picture_turns.hpp"
#include "flight_import/sample_logs.hpp"
#include "flight_import/sample_photos.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using test::SampleFlight;

constexpr double kOffset = -1'782'000'000.4;  // of log time less camera time

std::vector<CameraTrigger> irregular_triggers(int number) {
  std::vector<CameraTrigger> triggers;
  double time_s = 100;
  for (int i = 0; i < number; ++i) {
    triggers.push_back({time_s});
    time_s += 2 + 0.9 * std::sin(i * 1.7) + 0.4 * std::cos(i * i * 0.3);
  }
  return triggers;
}

std::vector<double> camera_times(const std::vector<CameraTrigger>& triggers, double step_s) {
  std::vector<double> times_s;
  for (const CameraTrigger& trigger : triggers) {
    const double exact_s = trigger.time_s - kOffset;
    times_s.push_back(step_s > 0 ? (std::floor(exact_s / step_s) + 0.5) * step_s : exact_s);
  }
  return times_s;
}

TEST(TriggerOffset, OneForOneWithWholeSeconds) {
  const auto triggers = irregular_triggers(60);
  const auto result = offset_from_triggers(camera_times(triggers, 1), 1, triggers, {});
  ASSERT_TRUE(result.offset) << result.why_not;
  EXPECT_NEAR(result.offset->offset_s, kOffset, 0.15);
  EXPECT_LT(result.offset->sigma_s, 0.1);
  EXPECT_LT(std::abs(result.offset->offset_s - kOffset), 4 * result.offset->sigma_s);
  for (std::size_t i = 0; i < 60; ++i) EXPECT_EQ(result.offset->triggers[i], i);
}

TEST(TriggerOffset, PhotosMissingAtBothEndsAndBetween) {
  const auto triggers = irregular_triggers(80);
  std::vector<CameraTrigger> kept(triggers.begin() + 7, triggers.begin() + 60);
  kept.erase(kept.begin() + 20, kept.begin() + 23);
  const auto result = offset_from_triggers(camera_times(kept, 0.01), 0.01, triggers, {});
  ASSERT_TRUE(result.offset) << result.why_not;
  EXPECT_NEAR(result.offset->offset_s, kOffset, 0.01);
  EXPECT_EQ(result.offset->supporting, kept.size());
  EXPECT_EQ(result.offset->triggers[0], 7U);
  EXPECT_EQ(result.offset->triggers.back(), 59U);
}

TEST(TriggerOffset, PhotosWithoutATriggerAmongThem) {
  const auto triggers = irregular_triggers(50);
  std::vector<double> times_s = camera_times(triggers, 0.01);
  times_s.insert(times_s.begin(), times_s.front() - 60);  // a test shot by hand
  const auto result = offset_from_triggers(times_s, 0.01, triggers, {});
  ASSERT_TRUE(result.offset) << result.why_not;
  EXPECT_NEAR(result.offset->offset_s, kOffset, 0.01);
  EXPECT_FALSE(result.offset->triggers[0]);
  EXPECT_EQ(result.offset->triggers[1], 0U);
}

TEST(TriggerOffset, ARegularCadenceDoesNotTell) {
  std::vector<CameraTrigger> triggers;
  for (int i = 0; i < 60; ++i) triggers.push_back({100 + 2.0 * i});
  const std::vector<CameraTrigger> kept(triggers.begin() + 5, triggers.begin() + 45);
  const auto times_s = camera_times(kept, 0.01);
  const auto result = offset_from_triggers(times_s, 0.01, triggers, {});
  ASSERT_FALSE(result.offset);
  EXPECT_THAT(result.why_not, ::testing::HasSubstr("too regular"));
  // As many photos as triggers decide.
  const auto all = offset_from_triggers(camera_times(triggers, 0.01), 0.01, triggers, {});
  ASSERT_TRUE(all.offset);
  EXPECT_NEAR(all.offset->offset_s, kOffset, 0.01);
}

TEST(TriggerOffset, OtherTriggersAreNotThePhotos) {
  const auto triggers = irregular_triggers(60);
  std::vector<double> times_s;
  Random random(5);
  double time_s = 5000;
  for (int i = 0; i < 40; ++i) times_s.push_back(time_s += 1 + 6 * random.uniform());
  const auto result = offset_from_triggers(times_s, 0.01, triggers, {});
  EXPECT_FALSE(result.offset);
  EXPECT_NE(result.why_not, "");
  EXPECT_FALSE(offset_from_triggers({}, 1, triggers, {}).offset);
  std::vector<CameraTrigger> flood;
  for (int i = 0; i < 200'000; ++i) flood.push_back({i * 0.01});
  EXPECT_THAT(offset_from_triggers(times_s, 1, flood, {}).why_not, ::testing::HasSubstr("200000 triggers"));
  EXPECT_FALSE(offset_from_triggers(times_s, 1, {}, {}).offset);
}

std::vector<TimedAttitude> logged(const SampleFlight& flight) {
  std::vector<TimedAttitude> attitudes;
  for (double t = flight.begin_s; t <= flight.end_s; t += 0.1) attitudes.push_back({t, flight.attitude_at(t)});
  return attitudes;
}

std::vector<SeenTurn> turns_of(const SampleFlight& flight, double from_s, double to_s, double noise_rad) {
  std::vector<SeenTurn> turns;
  Random random(3);
  for (double t = from_s; t + 2 <= to_s; t += 2) {
    const double turn = flight.attitude_at(t + 2).heading_rad - flight.attitude_at(t).heading_rad;
    turns.push_back({t - kOffset, t + 2 - kOffset, wrap_pi(turn + noise_rad * random.normal())});
  }
  return turns;
}

TEST(TurnOffset, TheTurnsOfALegTellTheOffset) {
  const SampleFlight flight;
  for (const double from_s : {100.0, 108.0}) {
    const auto result = offset_from_turns(turns_of(flight, from_s, 200, radians(1)), 0, logged(flight));
    ASSERT_TRUE(result.offset) << result.why_not;
    EXPECT_NEAR(result.offset->offset_s, kOffset, 0.2);
    EXPECT_LT(result.offset->sigma_s, 0.3);
  }
}

TEST(TurnOffset, OutliersDoNotMoveIt) {
  const SampleFlight flight;
  auto turns = turns_of(flight, 100, 215, radians(1));
  for (std::size_t i = 3; i < turns.size(); i += 9) turns[i].turn_rad += 2;
  const auto result = offset_from_turns(turns, 0, logged(flight));
  ASSERT_TRUE(result.offset) << result.why_not;
  EXPECT_NEAR(result.offset->offset_s, kOffset, 0.25);
}

TEST(TurnOffset, AStraightFlightTellsNothing) {
  std::vector<TimedAttitude> attitudes;
  std::vector<SeenTurn> turns;
  for (int i = 0; i < 1000; ++i) attitudes.push_back({i * 0.1, {1.0, 0, 0}});
  for (int i = 0; i < 30; ++i) turns.push_back({i * 2.0, i * 2.0 + 2, 0.001 * (i % 3)});
  const auto result = offset_from_turns(turns, 0, attitudes);
  ASSERT_FALSE(result.offset);
  EXPECT_THAT(result.why_not, ::testing::HasSubstr("turns too little"));
}

TEST(TurnOffset, EqualLoopsTellTooMuch) {
  std::vector<TimedAttitude> attitudes;
  std::vector<SeenTurn> turns;
  const auto heading = [](double t) { return 0.9 * std::sin(2 * kPi * t / 40); };
  for (int i = 0; i < 6000; ++i) attitudes.push_back({i * 0.1, {heading(i * 0.1), 0, 0}});
  for (int i = 0; i < 60; ++i) {
    turns.push_back({1000 + i * 2.0, 1002 + i * 2.0, wrap_pi(heading(102 + i * 2.0) - heading(100 + i * 2.0))});
  }
  const auto result = offset_from_turns(turns, 0, attitudes);
  ASSERT_FALSE(result.offset);
  EXPECT_THAT(result.why_not, ::testing::HasSubstr("repeats"));
}

TEST(TurnOffset, AnotherFlightsLogIsRefused) {
  const SampleFlight flight;
  auto turns = turns_of(flight, 100, 215, radians(1));
  for (std::size_t i = 0; i < turns.size(); ++i) turns[i].turn_rad = 0.8 * std::sin(static_cast<double>(i) * 1.3);
  EXPECT_FALSE(offset_from_turns(turns, 0, logged(flight)).offset);
  EXPECT_FALSE(offset_from_turns({}, 0, logged(flight)).offset);
  EXPECT_FALSE(offset_from_turns(turns, 0, {}).offset);
}

TEST(PictureTurns, SeesByHowMuchTheHeadingChanged) {
  const test::SampleGround ground;
  const cv::Mat before = ground.picture(0, 0, 30);
  for (const double turn_deg : {0.0, 12.0, -35.0, 90.0}) {
    const auto turn = turn_between(before, ground.picture(30, 40, 30 + turn_deg));
    ASSERT_TRUE(turn);
    EXPECT_NEAR(degrees(*turn), turn_deg, 0.5);
  }
  EXPECT_FALSE(turn_between(before, ground.picture(600, 500, 30)));  // elsewhere
  EXPECT_FALSE(turn_between(before, cv::Mat(240, 320, CV_8UC1, cv::Scalar(90))));
}

}  // namespace
}  // namespace nadir
