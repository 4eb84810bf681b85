// The fix stream is a function of what is recorded: the records of a flight, through the recorder's codec, make the
// same fixes again.
#include "fixes/fix_stream.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "base/random.hpp"
#include "geodesy/local_frame.hpp"
#include "recorder/record_codec.hpp"

namespace nadir {
namespace {

constexpr LonLat kTakeOff{8.5, 47.25};
constexpr std::int64_t kOneSecond = 1'000'000;
constexpr std::int64_t kUnixStart_us = 1'760'000'000'000'000;
constexpr FixStatus kServed{.served = true, .permitted = true, .source = SourceLabel::vo_extrapolated, .sigma_m = 2};

VisionEstimate estimate_at(std::int64_t captured_us, PlanePoint at) {
  return {.time_us = captured_us,
          .place = LocalFrame(kTakeOff).lonlat_from_plane(at),
          .sigma_m = 3,
          .north_mps = 1.5,
          .east_mps = 20,
          .speed_sigma_mps = 0.5,
          .msl_m = 600,
          .vertical_sigma_m = 2};
}

// A flight of a minute, as irregular as a real one: messages at their rates with jitter, estimates of old frames,
// corrections of them by map matches, a jump, half a minute without frames, and a position that is withdrawn.
class Flight {
 public:
  explicit Flight(std::uint64_t seed) : random_(seed) {
    for (std::int64_t now_us = 100 * kOneSecond; now_us < 160 * kOneSecond; now_us += random_.integer(500, 20'000)) {
      hear(now_us);
      see(now_us);
      FixStatus status = kServed;
      status.served = now_us > 101 * kOneSecond;
      status.permitted = now_us < 130 * kOneSecond || now_us > 132 * kOneSecond;
      status.sigma_m = now_us > 135 * kOneSecond ? 8 : 2;
      if (auto due = stream_.turn(now_us, kUnixStart_us + now_us, status)) {
        due->inputs.sent = status.served;
        fixes_.push_back(*std::move(due));
      }
    }
  }

  const std::vector<DueFix>& fixes() const { return fixes_; }
  const VisionEstimate& estimate(const FixInputRecord::ArrivedEstimate& which) const {
    return estimates_.at(2 * which.index + (which.late ? 1 : 0));
  }

 private:
  void hear(std::int64_t now_us) {
    const auto turned = static_cast<float>(static_cast<double>(now_us) * 2e-7);
    if (now_us >= attitude_due_us_) {
      stream_.on_input(now_us, FixInputRecord::Attitude{0.1F * turned, 0.05F, turned});
      attitude_due_us_ = now_us + kOneSecond / 25;
    }
    if (now_us >= force_due_us_) {
      const auto noise = [&] { return static_cast<float>(random_.normal()); };
      stream_.on_input(now_us, FixInputRecord::Acceleration{noise(), 2 + noise(), -9.8F + noise()});
      force_due_us_ = now_us + kOneSecond / 40;
    }
  }

  void see(std::int64_t now_us) {
    const bool blind = now_us > 110 * kOneSecond && now_us < 125 * kOneSecond;
    if (now_us < frame_due_us_ || blind) return;
    frame_due_us_ = now_us + 2 * kOneSecond / 3;
    const double east_m = 20e-6 * static_cast<double>(now_us - 100 * kOneSecond);
    const double off_m = now_us > 140 * kOneSecond ? 90 : 0;  // once, and for good
    const std::uint64_t index = estimates_.size() / 2;
    for (const bool late : {false, true}) {
      const VisionEstimate& estimate = estimates_.emplace_back(
          estimate_at(now_us - 150'000, {east_m + 5 * random_.normal(), off_m + 5 * random_.normal()}));
      if (!late || random_.chance(0.6)) stream_.on_input(now_us, {index, late}, estimate);
    }
  }

  Random random_;
  FixStream stream_;
  std::int64_t attitude_due_us_ = 0, force_due_us_ = 0, frame_due_us_ = 0;
  std::vector<VisionEstimate> estimates_;  // two of each frame
  std::vector<DueFix> fixes_;
};

FixInputRecord read_back(const FixInputRecord& inputs) {
  const auto record = decode(Topic::fix_input, encode(Record(inputs)));
  EXPECT_TRUE(record);
  return record ? std::get<FixInputRecord>(*record) : FixInputRecord{};
}

// One turn, as a replay makes it.
std::optional<DueFix> again(FixStream& stream, const FixInputRecord& inputs, const Flight& flight) {
  for (const FixInputRecord::Input& input : inputs.inputs) {
    if (const auto* which = std::get_if<FixInputRecord::ArrivedEstimate>(&input.what)) {
      stream.on_input(input.time_us, *which, flight.estimate(*which));
    } else if (const auto* attitude = std::get_if<FixInputRecord::Attitude>(&input.what)) {
      stream.on_input(input.time_us, *attitude);
    } else {
      stream.on_input(input.time_us, std::get<FixInputRecord::Acceleration>(input.what));
    }
  }
  return stream.turn(inputs.time_us, inputs.unix_us, inputs.status);
}

Bytes bits(const DueFix& fix) { return encode(Record(fix_record(fix))); }

TEST(FixStream, TheRecordsOfAFlightMakeTheSameFixes) {
  std::size_t positions = 0, none = 0, jumps = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Flight flight(seed);
    FixStream stream;
    ASSERT_GT(flight.fixes().size(), 550U);
    for (std::size_t i = 0; i < flight.fixes().size(); ++i) {
      const DueFix& flown = flight.fixes()[i];
      EXPECT_EQ(flown.inputs.number, i);
      const auto made = again(stream, read_back(flown.inputs), flight);
      ASSERT_TRUE(made) << i;
      ASSERT_EQ(bits(*made), bits(flown)) << i;
      EXPECT_EQ(made->jumped_m, flown.jumped_m);
      ++(flown.fix ? positions : none);
      jumps += flown.jumped_m ? 1U : 0U;
    }
  }
  EXPECT_GT(positions, 2000U);
  EXPECT_GT(none, 50U) << "before the first estimate, and while the position is withdrawn";
  EXPECT_GE(jumps, 5U);
}

// Or the test above would hold for a stream that ignores what enters.
TEST(FixStream, EachKindOfInputCounts) {
  const Flight flight(1);
  for (std::size_t kind = 0; kind < 3; ++kind) {
    FixStream stream;
    std::size_t other = 0;
    bool left_out = false;
    for (const DueFix& flown : flight.fixes()) {
      FixInputRecord inputs = flown.inputs;
      for (auto input = inputs.inputs.begin(); !left_out && flown.inputs.number > 50 && input != inputs.inputs.end();) {
        left_out = input->what.index() == kind;
        input = left_out ? inputs.inputs.erase(input) : input + 1;
      }
      const auto made = again(stream, inputs, flight);
      other += made && bits(*made) == bits(flown) ? 0U : 1U;
    }
    EXPECT_TRUE(left_out);
    EXPECT_GT(other, 0U) << "without one input of kind " << kind;
  }
}

TEST(FixStream, WithoutPermissionThereIsNoFixOfThatMoment) {
  FixStream stream(3);
  stream.on_input(100 * kOneSecond, {0, false}, estimate_at(100 * kOneSecond, {}));
  FixStatus status = kServed;
  status.permitted = false;
  const auto due = stream.turn(100 * kOneSecond, kUnixStart_us, status);
  ASSERT_TRUE(due);
  EXPECT_FALSE(due->fix);
  EXPECT_EQ(due->message.fix, GpsFix::no_gps);
  EXPECT_EQ(due->message.unix_us, kUnixStart_us);
  EXPECT_EQ(due->message.gps_id, 3);
  EXPECT_EQ(due->source, SourceLabel::no_fix);
  const FixRecord record = fix_record(*due);
  EXPECT_EQ(record.time_s, 100);
  EXPECT_FALSE(record.place || record.msl_m || record.north_mps);
  EXPECT_EQ(record.accuracy_m, 999);
}

TEST(FixStream, TheAccuracyIsNeverBelowThatOfTheStatus) {
  FixStream stream;
  stream.on_input(100 * kOneSecond, {0, false}, estimate_at(100 * kOneSecond, {}));
  FixStatus status = kServed;
  status.sigma_m = 40;
  const auto due = stream.turn(100 * kOneSecond, kUnixStart_us, status);
  ASSERT_TRUE(due && due->fix);
  EXPECT_EQ(due->message.horizontal_accuracy_m, 40);
  EXPECT_EQ(due->source, SourceLabel::vo_extrapolated);
}

TEST(FixStream, AJumpThatNobodySeesIsNone) {
  for (const bool served : {false, true}) {
    FixStream stream;
    FixStatus status = kServed;
    stream.on_input(100 * kOneSecond, {0, false}, estimate_at(100 * kOneSecond, {}));
    ASSERT_TRUE(stream.turn(100 * kOneSecond, kUnixStart_us, status));
    stream.on_input(101 * kOneSecond, {1, false}, estimate_at(101 * kOneSecond, {500, 500}));
    status.served = served;
    const auto due = stream.turn(101 * kOneSecond, kUnixStart_us, status);
    ASSERT_TRUE(due);
    EXPECT_EQ(due->jumped_m.has_value(), served);
  }
}

// Whoever floods the link fills neither the recorder's queue nor the disk, and the record says that it is incomplete.
TEST(FixStream, AFloodIsCountedNotRecorded) {
  FixStream stream;
  for (std::size_t i = 0; i < 3 * FixStream::kMaxInputs; ++i) {
    stream.on_input(100 * kOneSecond, FixInputRecord::Attitude{0, 0, static_cast<float>(i)});
  }
  const auto due = stream.turn(100 * kOneSecond, kUnixStart_us, kServed);
  ASSERT_TRUE(due);
  EXPECT_EQ(due->inputs.inputs.size(), FixStream::kMaxInputs);
  EXPECT_EQ(due->inputs.missing, 2 * FixStream::kMaxInputs);
  const auto next = stream.turn(101 * kOneSecond, kUnixStart_us, kServed);
  ASSERT_TRUE(next);
  EXPECT_EQ(next->inputs.number, 1U);
  EXPECT_EQ(next->inputs.missing, 0U);
  EXPECT_TRUE(next->inputs.inputs.empty());
}

TEST(FixStream, InputsThatAClockPutsAfterTheTurnOrHoursBeforeItCountAsMissing) {
  FixStream stream;
  stream.on_input(90'000 * kOneSecond, FixInputRecord::Attitude{});
  stream.on_input(100'000 * kOneSecond, FixInputRecord::Attitude{});
  stream.on_input(100'002 * kOneSecond, FixInputRecord::Attitude{});
  const auto due = stream.turn(100'001 * kOneSecond, kUnixStart_us, kServed);
  ASSERT_TRUE(due);
  ASSERT_EQ(due->inputs.inputs.size(), 1U);
  EXPECT_EQ(due->inputs.inputs.front().time_us, 100'000 * kOneSecond);
  EXPECT_EQ(due->inputs.missing, 2U);
}

TEST(FixStream, NumbersThatAreNoneMakeNoFixAndNoRecordThatCannotBeRead) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInfinity = std::numeric_limits<float>::infinity();
  FixStream stream;
  VisionEstimate estimate = estimate_at(100 * kOneSecond, {});
  estimate.sigma_m = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(stream.on_input(100 * kOneSecond, {0, false}, estimate));
  stream.on_input(100 * kOneSecond, FixInputRecord::Attitude{kNan, kInfinity, 0});
  stream.on_input(100 * kOneSecond, FixInputRecord::Acceleration{kNan, -kInfinity, kNan});
  FixStatus status = kServed;
  status.sigma_m = std::numeric_limits<double>::quiet_NaN();
  const auto due = stream.turn(100 * kOneSecond, kUnixStart_us, status);
  ASSERT_TRUE(due);
  EXPECT_FALSE(due->fix);
  EXPECT_EQ(encode(Record(read_back(due->inputs))), encode(Record(due->inputs)));
}

TEST(VisionEstimates, NeedAPositionAndATime) {
  Estimate estimate;
  StateEstimate state;
  EXPECT_FALSE(vision_estimate(estimate, state, 100, {}, 1e-5));
  estimate.position = kTakeOff;
  estimate.source = SourceLabel::dead_reckoned;
  for (const double time_s : {std::nan(""), 1e300, -1e300, double{INFINITY}}) {
    EXPECT_FALSE(vision_estimate(estimate, state, time_s, {}, 1e-5)) << time_s;
  }
  state.agl_m = 120;
  state.agl_sigma_m = 4;
  const auto over_unknown = vision_estimate(estimate, state, 100.5, {}, 1e-5);
  ASSERT_TRUE(over_unknown);
  EXPECT_EQ(over_unknown->time_us, 100'500'000);
  EXPECT_FALSE(over_unknown->visual || over_unknown->msl_m || over_unknown->vertical_sigma_m);
  const auto over_ground = vision_estimate(estimate, state, 100.5, 480.0, 1e-5);
  ASSERT_TRUE(over_ground);
  EXPECT_EQ(over_ground->msl_m, 600);
  EXPECT_EQ(over_ground->vertical_sigma_m, 4);
}

// 4.8 sigmas hold all but 1e-5 of a circular Gaussian, 6.07 all but 1e-8: typed in from tables of Rayleigh's
// distribution.
TEST(VisionEstimates, TheAccuracyBoundsTheProtectionLevel) {
  Estimate estimate;
  estimate.position = kTakeOff;
  estimate.sigma_m = 5;
  const auto accuracy_m = [&](std::optional<double> hpl_m, double risk) {
    estimate.hpl_m = hpl_m;
    return vision_estimate(estimate, {}, 100, {}, risk).value().sigma_m;
  };
  EXPECT_EQ(accuracy_m(std::nullopt, 1e-5), 5) << "no radius is known: the service withholds the fix, not this";
  EXPECT_EQ(accuracy_m(20, 1e-5), 5) << "smaller than what 5 m imply";
  EXPECT_NEAR(accuracy_m(24, 1e-5), 5, 0.01);
  EXPECT_NEAR(accuracy_m(96, 1e-5), 20, 0.01) << "a second place 60 m off, with little weight";
  EXPECT_NEAR(accuracy_m(96, 1e-8), 15.8, 0.05);
}

TEST(VisionEstimates, AProtectionLevelBeyondAllAccuraciesIsNoFix) {
  Estimate estimate;
  estimate.position = kTakeOff;
  estimate.source = SourceLabel::satellite_anchored;
  estimate.sigma_m = 5;
  estimate.hpl_m = 2500;  // 521 m as one sigma
  FixStream stream;
  const auto vision = vision_estimate(estimate, {}, 100, {}, 1e-5);
  ASSERT_TRUE(vision);
  ASSERT_TRUE(stream.on_input(100 * kOneSecond, {0, false}, *vision));
  const auto due = stream.turn(100 * kOneSecond, kUnixStart_us, kServed);
  ASSERT_TRUE(due);
  EXPECT_FALSE(due->fix);
  EXPECT_EQ(due->message.horizontal_accuracy_m, 999);
}

}  // namespace
}  // namespace nadir
