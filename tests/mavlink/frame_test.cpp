#include "mavlink/frame.hpp"

#include <gtest/gtest.h>

#include "base/random.hpp"
#include "mavlink/judge.hpp"
#include "mavlink/messages.hpp"

namespace nadir {
namespace {

constexpr const char* kMessages =
    R"({"message":"ATTITUDE","time_boot_ms":1000,"roll":0.25,"pitch":-0.5,"yaw":3.0,"rollspeed":0.1}
{"message":"STATUSTEXT","severity":4,"text":"EKF3 IMU0 is using GPS"}
{"message":"PARAM_VALUE","param_id":"GPS1_TYPE","param_value":14,"param_type":2,"param_count":900,"param_index":17}
)";

Bytes joined(const std::vector<Bytes>& frames) {
  Bytes all;
  for (const Bytes& frame : frames) all.insert(all.end(), frame.begin(), frame.end());
  return all;
}

std::vector<Bytes> drain(FrameReader& reader) {
  std::vector<Bytes> frames;
  while (auto frame = reader.next()) frames.push_back(std::move(frame->bytes));
  return frames;
}

class Frames : public ::testing::Test {
 protected:
  static const std::vector<Bytes>& good() {
    static const std::vector<Bytes> frames = test::frames_by_pymavlink(kMessages);
    return frames;
  }
  static const std::vector<Bytes>& first_version() {
    static const std::vector<Bytes> frames = test::frames_by_pymavlink(kMessages, "--version 1");
    return frames;
  }
};

TEST_F(Frames, BothVersionsAreRead) {
  for (const int version : {1, 2}) {
    FrameReader reader;
    reader.add(joined(version == 1 ? first_version() : good()));
    for (const std::uint32_t id : {30U, 253U, 22U}) {
      const auto frame = reader.next();
      ASSERT_TRUE(frame);
      EXPECT_EQ(frame->version, version);
      EXPECT_EQ(frame->message_id, id);
      EXPECT_EQ(frame->source, (MavlinkAddress{1, 1}));
      EXPECT_FALSE(frame->has_signature);
    }
    EXPECT_FALSE(reader.next());
    EXPECT_EQ(reader.counts().skipped_bytes, 0U);
  }
}

TEST_F(Frames, BytesMayComeOneByOne) {
  FrameReader reader;
  std::vector<Bytes> got;
  for (const std::uint8_t byte : joined(good())) {
    reader.add({&byte, 1});
    for (Bytes& frame : drain(reader)) got.push_back(std::move(frame));
  }
  EXPECT_EQ(got, good());
}

TEST_F(Frames, EveryFlippedBitIsRejectedAndTheNextFrameIsFound) {
  for (const auto* frames : {&good(), &first_version()}) {
    for (const Bytes& frame : *frames) {
      for (std::size_t bit = 0; bit < frame.size() * 8; ++bit) {
        Bytes damaged = frame;
        damaged[bit / 8] = static_cast<std::uint8_t>(damaged[bit / 8] ^ (1U << (bit % 8)));
        FrameReader reader;
        reader.add(damaged);
        reader.add(joined({frame, frame}));
        reader.finish();
        EXPECT_EQ(drain(reader), (std::vector<Bytes>{frame, frame})) << "bit " << bit;
        const FrameCounts& counts = reader.counts();
        EXPECT_GE(counts.bad_crc + counts.unknown + counts.incompatible + counts.truncated + counts.skipped_bytes, 1U);
      }
    }
  }
}

TEST_F(Frames, EveryKindOfDamageIsCounted) {
  const Bytes& frame = good()[0];
  const auto counts_of = [](const Bytes& bytes) {
    FrameReader reader;
    reader.add(bytes);
    reader.finish();
    while (reader.next()) {
    }
    return reader.counts();
  };
  Bytes bytes = frame;
  bytes[12] ^= 1U;
  EXPECT_EQ(counts_of(bytes).bad_crc, 1U);

  bytes = frame;
  bytes[2] = 0x40;
  EXPECT_EQ(counts_of(bytes).incompatible, 1U);

  bytes = frame;
  bytes[9] = 0xFF;  // message ids that high have no definition
  EXPECT_EQ(counts_of(bytes).unknown, 1U);
  EXPECT_EQ(counts_of(bytes).bad_crc, 0U);

  for (std::size_t size = 1; size < frame.size(); ++size) {
    EXPECT_GE(counts_of({frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(size)}).truncated, 1U) << size;
  }
  EXPECT_EQ(counts_of(frame).truncated, 0U);
  EXPECT_EQ(counts_of({'n', 'o', 'i', 's', 'e'}).skipped_bytes, 5U);
}

TEST_F(Frames, AStreamWaitsForTheRestAndADatagramDoesNot) {
  const Bytes& frame = good()[1];
  const ByteView half(frame.data(), 20);
  FrameReader stream;
  stream.add(half);
  EXPECT_FALSE(stream.next());
  stream.add(ByteView(frame).subspan(20));
  EXPECT_TRUE(stream.next());

  FrameReader datagrams;
  datagrams.add(half);
  datagrams.finish();
  EXPECT_FALSE(datagrams.next());
  datagrams.add(frame);
  datagrams.finish();
  EXPECT_TRUE(datagrams.next());
  EXPECT_EQ(datagrams.counts().frames, 1U);
}

TEST_F(Frames, NoiseBetweenFramesLosesNone) {
  Random random(7);
  for (int round = 0; round < 200; ++round) {
    Bytes stream;
    for (const Bytes& frame : good()) {
      for (int i = random.integer(0, 40); i > 0; --i)
        stream.push_back(static_cast<std::uint8_t>(random.integer(0, 255)));
      stream.insert(stream.end(), frame.begin(), frame.end());
    }
    FrameReader reader;
    reader.add(stream);
    reader.finish();
    const std::vector<Bytes> got = drain(reader);
    for (const Bytes& frame : good()) EXPECT_EQ(std::count(got.begin(), got.end(), frame), 1) << "round " << round;
  }
}

TEST_F(Frames, AFrameMarkedAsSignedIsStillValid) {
  Bytes frame = good()[0];
  mark_signed(frame);
  frame.resize(frame.size() + kSignatureSize);
  FrameReader reader;
  reader.add(frame);
  const auto read = reader.next();
  ASSERT_TRUE(read);
  EXPECT_TRUE(read->has_signature);
  EXPECT_EQ(read->bytes, frame);
}

}  // namespace
}  // namespace nadir
