// Fixes that are made again from a recording: of a whole one all of them, of a damaged one those before the damage, and
// of one that contradicts itself never more than it holds.
#include "replay/replayed_fixes.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/random.hpp"
#include "fixes/fix_stream.hpp"
#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

using testing::HasSubstr;

constexpr LonLat kStart{8.5, 47.25};
constexpr std::int64_t kSecond = 1'000'000;
constexpr std::size_t kFrames = 20;

EstimateRecord estimate_of(std::uint64_t index, bool late) {
  EstimateRecord record;
  record.index = index;
  record.estimate.frame = std::to_string(index) + ".jpg";
  const double east_m = 10.0 * static_cast<double>(index) + (late ? 3 : 0);
  record.estimate.position = LocalFrame(kStart).lonlat_from_plane({east_m, 1});
  record.estimate.sigma_m = late ? 2 : 4;
  record.estimate.source = late ? SourceLabel::satellite_anchored : SourceLabel::vo_extrapolated;
  record.state.velocity_mps = {20, 0.5};
  record.state.velocity_sigma_mps = 0.4;
  return record;
}

// Ten seconds with two frames a second, of which every second one is corrected by a late map match.
class FixesAgain : public ::testing::Test {
 protected:
  FixesAgain() {
    FixStream stream;
    for (std::int64_t now_us = 100 * kSecond; now_us < 110 * kSecond; now_us += 5'000) {
      if (now_us % 25'000 == 0) stream.on_input(now_us, FixInputRecord::Acceleration{0.1F, 1.5F, -9.7F});
      if (now_us % 40'000 == 0) stream.on_input(now_us, FixInputRecord::Attitude{0.1F, 0.02F, 1.5F});
      if (now_us % 500'000 == 100'000) see(stream, now_us, false);
      if (now_us % 1'000'000 == 400'000) see(stream, now_us, true);
      FixStatus status{.served = now_us > 101 * kSecond, .permitted = true, .source = SourceLabel::vo_extrapolated};
      auto due = stream.turn(now_us, 1'760'000'000 * kSecond + now_us, status);
      if (!due) continue;
      due->inputs.sent = status.served;
      if (due->inputs.sent) {
        flight_.fixes.push_back(fix_record(*due));
        flight_.fixes.back().gps = FixRecord::Receiver{0.2, 3, kStart, 500, 1.5};
      }
      flight_.fix_inputs.push_back(due->inputs);
    }
    estimates_ = flight_.estimates;
  }

  void see(FixStream& stream, std::int64_t now_us, bool late) {
    if (!late) {
      Telemetry& telemetry = flight_.flight.frames.emplace_back();
      telemetry.time_s = static_cast<double>(now_us) * 1e-6 - 0.08;
    }
    const std::uint64_t index = flight_.flight.frames.size() - 1;
    const EstimateRecord& record = flight_.estimates.emplace_back(estimate_of(index, late));
    const auto estimate = vision_estimate(record.estimate, record.state, flight_.flight.frames.back().time_s,
                                          std::nullopt, flight_.session.localizer.integrity_risk);
    stream.on_input(now_us, {index, late}, *estimate);
  }

  FixComparison compared() const { return replay_fixes(flight_, estimates_, nullptr).comparison; }

  static std::size_t left_out(const FixComparison& result) {
    std::size_t fixes = 0;
    for (const auto& interval : result.not_compared) fixes += interval.fixes;
    return fixes;
  }

  // All before `at` are identical, and the rest is left out for this reason.
  void expect_end(std::size_t at, const std::string& reason) const {
    const FixComparison result = compared();
    const auto before = static_cast<std::size_t>(
        std::ranges::count_if(flight_.fix_inputs.begin(), flight_.fix_inputs.begin() + static_cast<std::ptrdiff_t>(at),
                              [](const auto& inputs) { return inputs.sent; }));
    EXPECT_FALSE(result.first) << text_of(*result.first);
    EXPECT_EQ(result.identical, before);
    EXPECT_EQ(result.compared, before);
    ASSERT_EQ(result.not_compared.size(), 1U);
    EXPECT_EQ(result.not_compared.front().fixes, flight_.fixes.size() - before);
    EXPECT_EQ(result.not_compared.front().from_s, flight_.fixes[before].time_s);
    EXPECT_EQ(result.not_compared.front().to_s, flight_.fixes.back().time_s);
    EXPECT_THAT(text_of(result.not_compared.front()), HasSubstr(reason));
  }

  RecordedFlight flight_;
  std::vector<EstimateRecord> estimates_;  // of the replay
};

TEST_F(FixesAgain, AnotherProtectionLevelIsAnotherEstimateAndAnotherFix) {
  const std::size_t middle = estimates_.size() / 2;
  estimates_[middle].estimate.hpl_m = 480;  // 100 m as one sigma
  const Reproduction estimates = compare_estimates(flight_.estimates, estimates_);
  EXPECT_EQ(estimates.compared - estimates.same, 1U);
  EXPECT_EQ(estimates.first_other, flight_.estimates[middle].estimate.frame);
  const FixComparison fixes = compared();
  ASSERT_TRUE(fixes.first);
  EXPECT_EQ(fixes.first->field, "accuracy_m");
}

TEST_F(FixesAgain, OfAWholeRecordingAreIdentical) {
  ASSERT_EQ(flight_.flight.frames.size(), kFrames);
  ASSERT_GT(flight_.fixes.size(), 80U);
  const ReplayedFixes again = replay_fixes(flight_, estimates_, nullptr);
  EXPECT_EQ(again.comparison.compared, flight_.fixes.size());
  EXPECT_EQ(again.comparison.identical, flight_.fixes.size());
  EXPECT_FALSE(again.comparison.first);
  EXPECT_TRUE(again.comparison.not_compared.empty());
  ASSERT_EQ(again.fixes.size(), flight_.fixes.size());
  EXPECT_EQ(again.fixes.back().place, flight_.fixes.back().place);
  EXPECT_EQ(again.fixes.back().gps->accuracy_m, 1.5) << "the receiver's words, as they were recorded";
}

TEST_F(FixesAgain, TheFirstDifferenceIsNamed) {
  flight_.fixes[40].north_mps = 1.25;
  flight_.fixes[50].place->lat_deg = std::nextafter(flight_.fixes[50].place->lat_deg, 90);
  const FixComparison result = compared();
  EXPECT_EQ(result.identical, flight_.fixes.size() - 2);
  EXPECT_EQ(result.compared, flight_.fixes.size());
  ASSERT_TRUE(result.first);
  EXPECT_EQ(result.first->field, "north_mps");
  EXPECT_EQ(result.first->time_s, flight_.fixes[40].time_s);
  EXPECT_EQ(result.first->recorded, "1.25");
  EXPECT_THAT(text_of(*result.first), HasSubstr("north_mps: recorded 1.25, replayed 0.3"));
}

TEST_F(FixesAgain, AnEstimateThatDiffersMakesFixesThatDiffer) {
  estimates_[10].estimate.position->lon_deg += 1e-6;
  const FixComparison result = compared();
  ASSERT_TRUE(result.first);
  EXPECT_THAT(result.first->field, testing::AnyOf("lat_deg", "lon_deg"));
  EXPECT_GT(result.identical, 10U);
  EXPECT_LT(result.identical, result.compared);
  EXPECT_TRUE(result.not_compared.empty());
}

TEST_F(FixesAgain, TheOrderOfTheRecordsIsOfNoAccount) {
  std::ranges::reverse(flight_.fix_inputs);
  std::ranges::reverse(flight_.fixes);
  flight_.fix_inputs.push_back(flight_.fix_inputs[7]);  // and one twice
  const FixComparison result = compared();
  EXPECT_EQ(result.identical, flight_.fixes.size());
  EXPECT_EQ(left_out(result), 0U);
}

TEST_F(FixesAgain, AfterAMissingTurnNothingIsCompared) {
  flight_.fix_inputs.erase(flight_.fix_inputs.begin() + 60, flight_.fix_inputs.begin() + 64);
  expect_end(60, "turns 60 to 63 of /fix_input are missing");
}

TEST_F(FixesAgain, WithoutTheFirstTurnNothingIsCompared) {
  flight_.fix_inputs.erase(flight_.fix_inputs.begin());
  expect_end(0, "turns 0 to 0 of /fix_input are missing");
}

TEST_F(FixesAgain, OfAnOlderRecordingNothingIsCompared) {
  flight_.fix_inputs.clear();
  expect_end(0, "their inputs are not in the recording");
}

TEST_F(FixesAgain, AfterACutNothingIsCompared) {
  flight_.fix_inputs.resize(70);
  expect_end(70, "their inputs are not in the recording");
}

TEST_F(FixesAgain, AfterAnIncompleteTurnNothingIsCompared) {
  flight_.fix_inputs[55].missing = 12;
  expect_end(55, "turn 55 of /fix_input lacks 12 inputs");
}

TEST_F(FixesAgain, AfterATimeThatGoesBackNothingIsCompared) {
  flight_.fix_inputs[55].time_us = flight_.fix_inputs[54].time_us;
  expect_end(55, "turn 55 of /fix_input is not later than the one before");
}

TEST_F(FixesAgain, AfterInputsOutOfOrderNothingIsCompared) {
  auto& inputs = flight_.fix_inputs[55].inputs;
  ASSERT_GT(inputs.size(), 2U);
  std::ranges::reverse(inputs);
  expect_end(55, "inputs of turn 55 of /fix_input are not in order");
}

TEST_F(FixesAgain, AfterTheLastReplayedFrameNothingIsCompared) {
  std::erase_if(estimates_, [](const EstimateRecord& record) { return record.index >= 9; });
  const FixComparison result = compared();
  EXPECT_FALSE(result.first);
  EXPECT_EQ(result.identical, result.compared);
  EXPECT_GT(result.identical, 20U);
  ASSERT_EQ(result.not_compared.size(), 1U);
  EXPECT_THAT(result.not_compared.front().reason, HasSubstr("the estimate of frame 9 is not in the replay"));
  EXPECT_EQ(left_out(result) + result.compared, flight_.fixes.size());
}

// A lost anchor makes other estimates; the fixes that follow from them are no fault.
TEST_F(FixesAgain, WhereLostAnchorsMakeOtherEstimatesNothingIsCompared) {
  flight_.missing_between = 2;
  EXPECT_EQ(compared().identical, flight_.fixes.size()) << "as long as they come out the same";
  estimates_[10].estimate.sigma_m += 1;
  const FixComparison result = compared();
  EXPECT_FALSE(result.first);
  ASSERT_EQ(result.not_compared.size(), 1U);
  EXPECT_THAT(result.not_compared.front().reason, HasSubstr("2 records of /anchor and /hint are missing"));
  EXPECT_EQ(left_out(result) + result.compared, flight_.fixes.size());
}

TEST_F(FixesAgain, AFixThatIsNotRecordedIsNotCompared) {
  const double time_s = flight_.fixes[40].time_s, later_s = flight_.fixes[60].time_s;
  flight_.fixes.erase(flight_.fixes.begin() + 60);
  flight_.fixes.erase(flight_.fixes.begin() + 40);
  const FixComparison result = compared();
  EXPECT_EQ(result.identical, flight_.fixes.size());
  ASSERT_EQ(result.not_compared.size(), 2U);
  EXPECT_EQ(result.not_compared[0].from_s, time_s);
  EXPECT_EQ(result.not_compared[0].to_s, time_s);
  EXPECT_EQ(result.not_compared[1].from_s, later_s);
  EXPECT_THAT(result.not_compared[0].reason, HasSubstr("not in the recording (/fix)"));
}

TEST_F(FixesAgain, AFixThatNoTurnMadeIsADifference) {
  flight_.fix_inputs[40].sent = false;
  const FixComparison result = compared();
  ASSERT_TRUE(result.first);
  EXPECT_EQ(result.first->field, "fix");
  EXPECT_EQ(result.first->replayed, "none");
  EXPECT_EQ(result.identical + 1, result.compared);
}

TEST_F(FixesAgain, TimesThatAreNoneAreNotCompared) {
  flight_.fixes[40].time_s = std::numeric_limits<double>::quiet_NaN();
  flight_.fixes[41].time_s = -1e300;
  const FixComparison result = compared();
  EXPECT_EQ(result.identical, flight_.fixes.size() - 2);
  EXPECT_FALSE(result.first);
  EXPECT_EQ(left_out(result), 4U) << "the two, and two that were sent and are not recorded";
}

// Whatever a recording holds, every fix of it is accounted for once.
TEST_F(FixesAgain, ArbitraryRecordsAreCountedOnceAndNeverCrash) {
  Random random(17);
  const RecordedFlight whole = flight_;
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kInfinity = std::numeric_limits<double>::infinity();
  constexpr double kOdd[] = {0, -1, 1e18, 1e300, kNan, kInfinity};
  constexpr std::int64_t kTimes[] = {0, 1, 99 * kSecond, 200 * kSecond, 1'000'000'000'000'000'000};
  const auto pick = [&](const auto& list) { return list[random.integer(0, static_cast<int>(std::size(list)) - 1)]; };
  for (int round = 0; round < 300; ++round) {
    flight_ = whole;
    for (int i = random.integer(1, 6); i > 0; --i) {
      const auto at = [&](const auto& list) {
        return static_cast<std::size_t>(random.integer(0, static_cast<int>(list.size()) - 1));
      };
      FixInputRecord& inputs = flight_.fix_inputs[at(flight_.fix_inputs)];
      switch (random.integer(0, 8)) {
        case 0: inputs.number = static_cast<std::uint64_t>(random.integer(0, 99)); break;
        case 1: inputs.time_us = pick(kTimes); break;
        case 2: inputs.status.sigma_m = pick(kOdd); break;
        case 3: inputs.inputs.clear(); break;
        case 4: flight_.flight.frames[at(flight_.flight.frames)].time_s = pick(kOdd); break;
        case 5: flight_.fixes[at(flight_.fixes)].time_s = pick(kOdd); break;
        case 6:
          inputs.inputs.push_back({pick(kTimes), FixInputRecord::ArrivedEstimate{std::uint64_t{1} << 63, true}});
          break;
        case 7: inputs.inputs.push_back({inputs.time_us, FixInputRecord::Acceleration{NAN, INFINITY, 1e30F}}); break;
        default: inputs.unix_us = pick(kTimes);
      }
    }
    const FixComparison result = compared();
    EXPECT_LE(result.identical, result.compared);
    EXPECT_EQ(result.first.has_value(), result.identical != result.compared);
    EXPECT_LE(result.compared, flight_.fixes.size());
    EXPECT_GE(result.compared + left_out(result), flight_.fixes.size());
  }
}

}  // namespace
}  // namespace nadir
