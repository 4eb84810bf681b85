// Records to FlatBuffers and back; that others read the same values is tests/recorder/independent_test.py.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "recorder/record_codec.hpp"
#include "recorder/sample_records.hpp"

namespace nadir {
namespace {

TEST(RecordCodec, EveryKindRoundTripsBitForBit) {
  Random random(11);
  for (int round = 0; round < 50; ++round) {
    for (const Record& record : test::sample_records(random)) {
      const Bytes bytes = encode(record);
      const auto back = decode(topic_of(record), bytes);
      ASSERT_TRUE(back) << name_of(topic_of(record));
      EXPECT_TRUE(test::same(*back, record)) << name_of(topic_of(record));
    }
  }
}

TEST(RecordCodec, TheSessionKeepsWhatTheLocalizerStartedFrom) {
  const SessionRecord session = test::sample_session();
  const auto back = decode(Topic::session, encode(Record(session)));
  ASSERT_TRUE(back);
  const auto& read = std::get<SessionRecord>(*back);
  EXPECT_EQ(read.camera.camera.distortion, session.camera.camera.distortion);
  EXPECT_EQ(read.camera.camera.fx, 1400.5);
  EXPECT_EQ(read.camera.uncertainty.tilt_rad, 0.04);
  EXPECT_EQ(read.camera.uncertainty.imu_dv_mps, 0.05);
  ASSERT_TRUE(read.camera.readout);
  EXPECT_EQ(read.camera.readout->duration_s, 0.02);
  EXPECT_EQ(read.camera.readout->direction, SensorReadout::Direction::left);
  EXPECT_TRUE(read.camera.on_gimbal);
  EXPECT_EQ(read.localizer.integrity_risk, 1e-6);
  EXPECT_EQ(read.localizer.area->north_m, 400);
  EXPECT_EQ(read.start, session.start);
  EXPECT_EQ(read.package, session.package);
  EXPECT_EQ(read.picture_shrink, 2);
  EXPECT_TRUE(read.terrain);
  EXPECT_FALSE(read.places);
  EXPECT_TRUE(read.matchability);
  EXPECT_TRUE(read.localizer.resumed);
}

TEST(RecordCodec, ARollingShutterOrAGimbalTakesSpaceOnlyWhereThereIsOne) {
  SessionRecord session = test::sample_session();
  InputRecord input;
  const std::size_t with = encode(Record(session)).size(), plain = encode(Record(input)).size();
  session.camera.readout.reset();
  session.camera.on_gimbal = false;
  EXPECT_LT(encode(Record(session)).size(), with);
  const auto back = decode(Topic::session, encode(Record(session)));
  EXPECT_FALSE(std::get<SessionRecord>(*back).camera.readout);
  EXPECT_FALSE(std::get<SessionRecord>(*back).camera.on_gimbal);
  input.telemetry.rate_rad_s = {0.1, 0.2, 0.3};
  EXPECT_LT(plain, encode(Record(input)).size());
}

TEST(RecordCodec, KeepsUnknownValuesAndSpecialNumbers) {
  InputRecord input;
  input.telemetry.time_s = std::numeric_limits<double>::quiet_NaN();
  input.telemetry.agl_m = -0.0;
  input.telemetry.pitch_rad = std::numeric_limits<double>::infinity();
  const auto back = decode(Topic::input, encode(Record(input)));
  ASSERT_TRUE(back);
  const Telemetry& telemetry = std::get<InputRecord>(*back).telemetry;
  EXPECT_TRUE(std::isnan(telemetry.time_s));
  EXPECT_TRUE(telemetry.agl_m && *telemetry.agl_m == 0 && std::signbit(*telemetry.agl_m));
  EXPECT_FALSE(telemetry.heading_rad);
  EXPECT_EQ(telemetry.pitch_rad, std::numeric_limits<double>::infinity());
  EXPECT_FALSE(telemetry.gps_position);
}

// A table without its last fields is what earlier versions wrote: FlatBuffers leaves out values that are the default.
TEST(RecordCodec, RecordingsWithoutProtectionLevelsHaveNone) {
  EstimateRecord estimate = test::sample_estimate(1);
  estimate.estimate.hpl_m.reset();
  const Bytes without = encode(Record(estimate));
  estimate.estimate.hpl_m = 31.25;
  const Bytes with = encode(Record(estimate));
  EXPECT_LT(without.size(), with.size());
  EXPECT_FALSE(std::get<EstimateRecord>(*decode(Topic::estimate, without)).estimate.hpl_m);
  EXPECT_EQ(std::get<EstimateRecord>(*decode(Topic::estimate, with)).estimate.hpl_m, 31.25);

  AnchorRecord anchor;
  anchor.anchor.verdict = AnchorVerdict::accepted;
  const Bytes old = encode(Record(anchor));
  anchor.anchor.log_likelihood_ratio = 9.5;
  anchor.anchor.place_doubt = 3e-6;
  EXPECT_LT(old.size(), encode(Record(anchor)).size());
  const auto back = decode(Topic::anchor, old);
  ASSERT_TRUE(back);
  EXPECT_EQ(std::get<AnchorRecord>(*back).anchor.log_likelihood_ratio, 0);
  EXPECT_EQ(std::get<AnchorRecord>(*back).anchor.place_doubt, 1) << "nothing is known to be in its favour";
}

// Times that the fix stream cannot compute with, and lists that contradict their order.
TEST(RecordCodec, InputsOfFixesThatCannotBeAreRejected) {
  FixInputRecord good;
  good.time_us = 100'000'000;
  good.inputs = {{99'000'000, FixInputRecord::Attitude{1, 2, 3}},
                 {99'000'001, FixInputRecord::Acceleration{4, 5, 6}},
                 {99'000'002, FixInputRecord::ArrivedEstimate{7, true}}};
  const Bytes bytes = encode(Record(good));
  const auto back = decode(Topic::fix_input, bytes);
  ASSERT_TRUE(back);
  const auto& read = std::get<FixInputRecord>(*back);
  ASSERT_EQ(read.inputs.size(), 3U);
  EXPECT_EQ(read.inputs[2].time_us, 99'000'002);
  EXPECT_EQ(std::get<FixInputRecord::ArrivedEstimate>(read.inputs[2].what).index, 7U);

  for (const std::int64_t time_us :
       {std::int64_t{-1}, std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max()}) {
    FixInputRecord bad;
    bad.time_us = time_us;
    EXPECT_FALSE(decode(Topic::fix_input, encode(Record(bad)))) << time_us;
    std::swap(bad.time_us, bad.unix_us);
    EXPECT_FALSE(decode(Topic::fix_input, encode(Record(bad)))) << time_us;
  }
  const std::array<std::uint8_t, 7> order{3, 0, 0, 0, 0, 1, 2};
  const auto at = std::ranges::search(bytes, order).begin() - bytes.begin() + 4;
  for (const std::uint8_t kind : {std::uint8_t{1}, std::uint8_t{3}, std::uint8_t{255}}) {
    Bytes bad = bytes;
    bad.at(static_cast<std::size_t>(at)) = kind;
    EXPECT_FALSE(decode(Topic::fix_input, bad)) << int{kind};
  }
}

TEST(RecordCodec, RandomBytesNeverCrash) {
  Random random(5);
  for (const Record& record : test::sample_records(random)) {
    const Bytes good = encode(record);
    for (std::size_t cut = 0; cut < good.size(); ++cut) {
      static_cast<void>(decode(topic_of(record), ByteView(good).first(cut)));
    }
    for (int round = 0; round < 2000; ++round) {
      Bytes bad = good;
      const int flips = random.integer(1, 4);
      for (int i = 0; i < flips; ++i) {
        const auto at = static_cast<std::size_t>(random.integer(0, static_cast<int>(bad.size()) - 1));
        bad[at] = static_cast<std::uint8_t>(random.integer(0, 255));
      }
      if (const auto read = decode(topic_of(record), bad)) static_cast<void>(encode(*read));
    }
    EXPECT_FALSE(decode(topic_of(record), {}));
  }
}

TEST(RecordCodec, RedactsKeys) {
  SessionRecord session = test::sample_session();
  session.settings = {{"signing_key", "0123456789abcdef"},
                      {"note", "-----BEGIN PRIVATE KEY-----\nMC4CAQ"},
                      {"api Token", "abc"},
                      {"matcher", "channels"}};
  const Bytes bytes = encode(Record(session));
  const std::string_view text = as_text(bytes);
  EXPECT_EQ(text.find("0123456789abcdef"), std::string_view::npos);
  EXPECT_EQ(text.find("MC4CAQ"), std::string_view::npos);
  EXPECT_EQ(text.find("abc\0"), std::string_view::npos);
  EXPECT_NE(text.find("channels"), std::string_view::npos);
}

TEST(Topics, NamesRoundTrip) {
  for (std::size_t i = 0; i < kTopics; ++i) {
    const auto topic = static_cast<Topic>(i);
    EXPECT_EQ(parse_topic(name_of(topic)), topic);
    EXPECT_FALSE(mcap_schema(topic).data.empty());
    EXPECT_EQ(mcap_channel(topic).schema_id, mcap_schema(topic).id);
  }
  EXPECT_FALSE(parse_topic("/nothing"));
}

}  // namespace
}  // namespace nadir
