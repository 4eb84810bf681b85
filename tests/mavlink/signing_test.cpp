#include "mavlink/signing.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "mavlink/judge.hpp"
#include "mavlink/messages.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

constexpr MavlinkAddress kSigner{1, 191};
constexpr std::uint64_t kTicks = kSigningTicksPerSecond;    // of a second
constexpr std::int64_t kSigned_us = 1'730'291'696'000'000;  // 2024-10-30T12:34:56Z
const std::string kSigningKeyHex = "00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff";
constexpr const char* kAttitude = R"({"message":"ATTITUDE","roll":0.25})";

SigningKey key() { return SigningKey(Sha256::from_hex(kSigningKeyHex)->bytes); }

class SignedLink : public ::testing::Test {
 protected:
  static std::string options(std::uint64_t timestamp, int link = 0, int system = 1) {
    return "--key " + kSigningKeyHex + " --timestamp " + std::to_string(timestamp) + " --link " + std::to_string(link) +
           " --system " + std::to_string(system);
  }
  // A frame of pymavlink's, signed at that time.
  static Bytes theirs(std::uint64_t timestamp, int link = 0, int system = 1) {
    return test::frames_by_pymavlink(kAttitude, options(timestamp, link, system)).at(0);
  }
  // Frames signed one second after the other.
  static std::vector<Bytes> a_second_apart(int count, std::uint64_t first, int link) {
    std::string messages;
    for (int i = 0; i < count; ++i) messages += std::string(kAttitude) + "\n";
    return test::frames_by_pymavlink(messages, options(first, link) + " --step " + std::to_string(kTicks));
  }
  SignatureVerdict judged(const Bytes& bytes, std::int64_t monotonic_us = 0) {
    FrameReader reader;
    reader.add(bytes);
    const auto frame = reader.next();
    if (!frame) throw std::runtime_error("no sound frame");
    return signing_.check(*frame, monotonic_us);
  }

  test::TemporaryFolder folder_;
  SigningTime time_{folder_ / "time", kSigned_us, 0};
  Signing signing_{key(), time_, 3};
  const std::uint64_t now_ = signing_time_of(kSigned_us);
};

TEST_F(SignedLink, PymavlinkAcceptsEveryFrameThatWeSign) {
  std::vector<Bytes> frames;
  for (int i = 0; i < 600; ++i) {  // over the sequence number's end, faster than the clock ticks
    frames.push_back(
        signing_.sign(encode(StatusText{TextSeverity::info, std::string(static_cast<std::size_t>(i % 50), 'x'), 0, 0},
                             kSigner, static_cast<std::uint8_t>(i)),
                      i));
  }
  frames.push_back(signing_.sign(encode(GpsInput{.unix_us = kSigned_us}, kSigner, 1), 700));
  const auto read = test::read_by_pymavlink(frames, options(now_));
  ASSERT_EQ(read.size(), frames.size());
  for (const auto& message : read) {
    ASSERT_FALSE(message.contains("refused")) << message;
    EXPECT_EQ(message["signed"], true);
  }
  const auto foreign = test::read_by_pymavlink({frames[0]}, "--key " + std::string(64, '0'));
  EXPECT_TRUE(foreign.at(0).contains("refused")) << "the judge must be able to refuse";
}

TEST_F(SignedLink, WeAcceptPymavlinks) {
  EXPECT_EQ(judged(theirs(now_)), SignatureVerdict::accepted);
  EXPECT_EQ(judged(theirs(now_ + 1)), SignatureVerdict::accepted);
  EXPECT_EQ(signing_.counts().accepted, 2U);
}

TEST_F(SignedLink, EveryFlippedBitIsRejected) {
  const Bytes frame = theirs(now_);
  std::uint64_t reached = 0;
  for (std::size_t bit = 0; bit < frame.size() * 8; ++bit) {
    Bytes damaged = frame;
    damaged[bit / 8] = static_cast<std::uint8_t>(damaged[bit / 8] ^ (1U << (bit % 8)));
    FrameReader reader;
    reader.add(damaged);
    reader.finish();
    while (const auto read = reader.next()) {
      EXPECT_NE(signing_.check(*read, 0), SignatureVerdict::accepted) << "bit " << bit;
      ++reached;
    }
  }
  EXPECT_EQ(reached, kSignatureSize * 8) << "the checksum covers everything but the signature";
  EXPECT_EQ(signing_.counts().wrong, kSignatureSize * 8);
  EXPECT_EQ(judged(frame), SignatureVerdict::accepted);
}

TEST_F(SignedLink, OtherKeysAreRejected) {
  const auto frame =
      test::frames_by_pymavlink(kAttitude, "--timestamp " + std::to_string(now_) + " --key " + std::string(64, 'a'));
  EXPECT_EQ(judged(frame.at(0)), SignatureVerdict::wrong);
}

TEST_F(SignedLink, FramesWithoutASignatureAreRejected) {
  EXPECT_EQ(judged(test::frames_by_pymavlink(kAttitude).at(0)), SignatureVerdict::without);
  EXPECT_EQ(judged(test::frames_by_pymavlink(kAttitude, "--version 1").at(0)), SignatureVerdict::without);
  EXPECT_EQ(signing_.counts().without, 2U);
}

TEST_F(SignedLink, ReplaysAreRejectedPerStream) {
  EXPECT_EQ(judged(theirs(now_ + 5)), SignatureVerdict::accepted);
  EXPECT_EQ(judged(theirs(now_ + 5)), SignatureVerdict::replayed);
  EXPECT_EQ(judged(theirs(now_ + 4)), SignatureVerdict::replayed);
  EXPECT_EQ(judged(theirs(now_ + 4, 1)), SignatureVerdict::accepted) << "another link";
  EXPECT_EQ(judged(theirs(now_ + 4, 0, 2)), SignatureVerdict::accepted) << "another system";
  EXPECT_EQ(signing_.counts().replayed, 2U);
}

// A frame that was recorded before a restart must not be the first contact after it.
TEST_F(SignedLink, AReplayAfterARestartIsRejected) {
  const std::filesystem::path file = folder_ / "streams";
  const Bytes recorded = theirs(now_);
  const Bytes later = theirs(now_ + kStreamReserve_us / 10);  // came after the last save, before the crash
  const Bytes live = theirs(now_ + kStreamReserve_us / 10 + 1);
  const auto judged_by = [&](StreamTimestamps& streams, const Bytes& bytes) {
    Signing signing(key(), time_, 3, &streams);
    FrameReader reader;
    reader.add(bytes);
    return signing.check(*reader.next(), 0);
  };
  {
    StreamTimestamps streams(file);
    EXPECT_EQ(judged_by(streams, recorded), SignatureVerdict::accepted);
    streams.save();
  }
  StreamTimestamps streams(file);
  EXPECT_EQ(streams.fault(), "");
  EXPECT_EQ(judged_by(streams, recorded), SignatureVerdict::replayed);
  EXPECT_EQ(judged_by(streams, later), SignatureVerdict::replayed);
  EXPECT_EQ(judged_by(streams, live), SignatureVerdict::accepted);
  EXPECT_EQ(judged_by(streams, theirs(now_, 0, 9)), SignatureVerdict::accepted) << "another system has its own";
}

// A service that was killed answers its autopilot with a timestamp ahead of its own. Whoever received that rejects what
// is earlier, so everything that follows is later, however long the restart took and before the next save() of the
// time.
TEST_F(SignedLink, EverythingAfterAnAnswerIsAcceptedByItsReceiver) {
  const auto timestamp_of = [](const Bytes& frame) {
    std::uint64_t timestamp = 0;
    for (std::size_t i = 6; i > 0; --i) timestamp = (timestamp << 8) | frame[frame.size() - kSignatureSize + i];
    return timestamp;
  };
  for (const std::int64_t away_us : {0, 700'000, 1'300'000, 1'450'000, 1'500'000, 2'000'000, 9'000'000}) {
    SCOPED_TRACE(away_us);
    folder_.write("time", std::to_string(now_) + "\n");
    {
      StreamTimestamps streams(folder_ / "streams");
      ASSERT_TRUE(streams.set({1, 1}, 0, now_));
      streams.save();
    }
    StreamTimestamps streams(folder_ / "streams");
    SigningTime time(folder_ / "time", kSigned_us + away_us, 0);
    Signing signing(key(), time, 3, &streams);
    const auto read = [](const Bytes& bytes) {
      FrameReader reader;
      reader.add(bytes);
      return *reader.next();
    };
    const auto heartbeat = [] { return encode(OwnHeartbeat{}, kSigner, 0); };
    std::vector<Bytes> sent;
    const MavlinkFrame seen = read(theirs(now_ + 1));
    for (const std::int64_t us : {0, 50'000}) {
      ASSERT_EQ(signing.check(seen, us), SignatureVerdict::replayed);
      sent.push_back(signing.sign_answer(heartbeat(), seen, us));
      sent.push_back(signing.sign(heartbeat(), us));
    }
    // The autopilot takes over the time of the first answer: the second is still on its way.
    ASSERT_EQ(signing.check(read(theirs(timestamp_of(sent[0]) + 1)), 60'000), SignatureVerdict::accepted);
    const std::size_t before = sent.size();
    for (std::int64_t us = 60'000; us < 3'000'000; us += 100'000) {
      if (us == 960'000 || us == 1'960'000) time.save(us);
      sent.push_back(signing.sign(heartbeat(), us));
    }
    for (const auto& message : test::read_by_pymavlink(sent, options(now_))) EXPECT_FALSE(message.contains("refused"));
    for (std::size_t i = 1; i < sent.size(); ++i) {
      EXPECT_GT(timestamp_of(sent[i]), timestamp_of(sent[i - 1])) << "frame " << i;
    }
    EXPECT_GE(timestamp_of(sent[before]) + kTicks / 10, time.now(60'000)) << "no later save() is waited for";
    EXPECT_GE(std::stoull(read_text_file(folder_ / "time")), timestamp_of(sent.back())) << "reserved";
    EXPECT_LE(time.now(60'000),
              now_ + static_cast<std::uint64_t>(std::max<std::int64_t>(away_us, 1'500'000)) / 10 + kTicks)
        << "and no further ahead than the answer";
  }
}

// After a clean end nothing is saved ahead: the next start accepts the frame that follows.
TEST_F(SignedLink, AfterACleanEndTheNextFrameIsAccepted) {
  const std::filesystem::path file = folder_ / "streams";
  {
    StreamTimestamps streams(file);
    EXPECT_TRUE(streams.set({1, 1}, 0, now_));
    streams.save();
    EXPECT_GT(StreamTimestamps(file).last({1, 1}, 0), now_);
    streams.save(StreamTimestamps::When::clean_end);
  }
  EXPECT_EQ(StreamTimestamps(file).last({1, 1}, 0), now_);
  StreamTimestamps empty(folder_ / "none");
  empty.save(StreamTimestamps::When::clean_end);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "none"));
}

TEST_F(SignedLink, DamagedTimestampsOfStreamsAreReportedAndTheLinkContinues) {
  const std::string whole = "nadir.signing-streams/1\n1 1 0 123\n255 190 7 281474976710655\n";
  folder_.write("streams", whole);
  EXPECT_EQ(StreamTimestamps(folder_ / "streams").last({255, 190}, 7), (std::uint64_t{1} << 48) - 1);
  for (std::size_t size = 0; size < whole.size(); ++size) {  // torn after every byte; whole lines are whole files
    folder_.write("streams", whole.substr(0, size));
    const StreamTimestamps streams(folder_ / "streams");
    const bool whole_lines = size > 0 && whole[size - 1] == '\n';
    EXPECT_EQ(streams.fault().empty(), whole_lines) << size;
    if (!whole_lines) {
      EXPECT_FALSE(streams.last({1, 1}, 0)) << size;
    }
  }
  for (const std::string line : {"256 1 0 1", "1 1 0 -1", "1 1 0", "1 1 0 1 1", " 1 1 0 x", "1 1 0 999999999999999"}) {
    folder_.write("streams", "nadir.signing-streams/1\n" + line + "\n");
    EXPECT_NE(StreamTimestamps(folder_ / "streams").fault(), "") << line;
  }
  StreamTimestamps nowhere(folder_ / "no-folder" / "streams");
  EXPECT_TRUE(nowhere.set({1, 1}, 0, 5));
  nowhere.save();
  EXPECT_EQ(nowhere.failed_saves(), 1U);
}

TEST_F(SignedLink, OldTimestampsAreRejected) {
  const std::uint64_t minute = 60 * kSigningTicksPerSecond;
  EXPECT_EQ(judged(theirs(now_ - minute - 1)), SignatureVerdict::too_old);
  EXPECT_EQ(judged(theirs(now_ - minute)), SignatureVerdict::accepted);
  EXPECT_EQ(judged(theirs(now_ - minute + 1), 1'000'000), SignatureVerdict::too_old) << "our clock goes on";
  EXPECT_EQ(signing_.counts().too_old, 2U);
}

// A clock that is ten minutes behind, or that was lost without a battery: the autopilot's time counts within a second.
TEST_F(SignedLink, TheAutopilotsTimeIsFollowedWhenItStaysAhead) {
  const std::uint64_t ahead = now_ + 3600 * kTicks;
  EXPECT_EQ(judged(theirs(ahead)), SignatureVerdict::too_new);
  EXPECT_EQ(judged(theirs(ahead + kTicks / 2), 500'000), SignatureVerdict::too_new);
  EXPECT_EQ(time_.now(500'000), now_ + kTicks / 2) << "two frames move nothing";
  EXPECT_EQ(judged(theirs(ahead + kTicks), 1'000'000), SignatureVerdict::accepted);
  EXPECT_GE(time_.take(1'000'000), ahead);
  EXPECT_GE(time_.now(2'000'000), ahead + 2 * kTicks) << "and goes on from there";
  EXPECT_EQ(judged(theirs(now_, 1), 2'000'000), SignatureVerdict::too_old);
}

// Whoever holds the key can send one; nothing of it may last.
TEST_F(SignedLink, OneFrameTenYearsAheadMovesNothing) {
  const std::uint64_t decade = now_ + std::uint64_t{10} * 365 * 86'400 * kTicks;
  EXPECT_EQ(judged(theirs(decade)), SignatureVerdict::too_new);
  EXPECT_EQ(signing_.counts().too_new, 1U);
  EXPECT_EQ(judged(theirs(now_ + kTicks), 1'000'000), SignatureVerdict::accepted)
      << "the same stream, at its right time";
  time_.save(1'000'000);
  EXPECT_LE(std::stoull(read_text_file(folder_ / "time")), now_ + 2 * kTicks);
  std::int64_t us = 10'000'000;
  for (const Bytes& frame : a_second_apart(100, decade, 5)) {  // however many, and however patiently
    EXPECT_EQ(judged(frame, us), SignatureVerdict::too_new);
    us += 1'000'000;
  }
  EXPECT_LE(time_.now(110'000'000), now_ + 111 * kTicks);
}

// Frames that are ahead by less are ordinary, but never push our time beyond a minute, in which right ones still count.
TEST_F(SignedLink, ManyFramesSomewhatAheadDoNotLockTheRightTimeOut) {
  std::int64_t us = 0;
  for (const Bytes& frame : a_second_apart(200, now_ + 59 * kTicks, 7)) {
    judged(frame, us);
    us += 10'000;
  }
  EXPECT_LE(time_.now(us), now_ + 63 * kTicks);
  EXPECT_EQ(judged(theirs(now_ + 3 * kTicks), us), SignatureVerdict::accepted);
}

TEST_F(SignedLink, WhileOthersAreAcceptedAnotherTimeIsNotFollowed) {
  const std::vector<Bytes> right = a_second_apart(20, now_, 0), ahead = a_second_apart(20, now_ + 86'400 * kTicks, 9);
  for (std::size_t i = 0; i < right.size(); ++i) {
    const auto us = static_cast<std::int64_t>(i) * 1'000'000;
    EXPECT_EQ(judged(right[i], us), SignatureVerdict::accepted);
    EXPECT_EQ(judged(ahead[i], us), SignatureVerdict::too_new);
  }
}

// Our clock runs two years ahead after a reboot in the air: the file of the last run says what was reached, and the
// autopilot's frames, newer than that, are followed back.
TEST(SigningAfterAReboot, AClockTwoYearsAheadFollowsTheAutopilotBack) {
  const test::TemporaryFolder folder;
  const std::uint64_t now = signing_time_of(kSigned_us);
  folder.write("time", std::to_string(now) + "\n");
  const std::int64_t wrong_us = kSigned_us + std::int64_t{2} * 365 * 86'400 * 1'000'000;
  SigningTime time(folder / "time", wrong_us, 0);
  Signing signing(key(), time, 3);
  EXPECT_LE(time.take(0), now + kTicks) << "no peer yet: timestamps continue from the last run's";
  const auto judged = [&](std::uint64_t timestamp, std::int64_t us) {
    FrameReader reader;
    reader.add(test::frames_by_pymavlink(kAttitude,
                                         "--key " + kSigningKeyHex + " --timestamp " + std::to_string(timestamp))[0]);
    return signing.check(*reader.next(), us);
  };
  EXPECT_EQ(judged(now - 120 * kTicks, 0), SignatureVerdict::too_old);
  EXPECT_EQ(judged(now - 119 * kTicks, 600'000), SignatureVerdict::too_old);
  EXPECT_EQ(judged(now - 118 * kTicks, 1'200'000), SignatureVerdict::too_old) << "recorded before the reboot";
  EXPECT_EQ(judged(now + 5 * kTicks, 2'000'000), SignatureVerdict::too_old);
  EXPECT_EQ(judged(now + 5 * kTicks + kTicks / 2, 2'500'000), SignatureVerdict::too_old);
  EXPECT_EQ(judged(now + 6 * kTicks, 3'000'000), SignatureVerdict::accepted);
  time.save(4'000'000);
  EXPECT_LE(std::stoull(read_text_file(folder / "time")), now + 10 * kTicks) << "the next start is not two years ahead";
}

// What was followed beyond our own clock is not written beyond a day of it.
TEST(SigningAfterAReboot, AnUnconfirmedTimeDoesNotOutliveTheRun) {
  const test::TemporaryFolder folder;
  SigningTime time(folder / "time", kSigned_us, 0);
  const std::uint64_t year = signing_time_of(kSigned_us) + std::uint64_t{365} * 86'400 * kTicks;
  ASSERT_TRUE(time.follow(year, 0));
  EXPECT_GE(time.take(0), year);
  time.save(1'000'000);
  EXPECT_LE(std::stoull(read_text_file(folder / "time")), signing_time_of(kSigned_us) + 86'402 * kTicks);
  EXPECT_FALSE(time.follow(signing_time_of(kSigned_us) + std::uint64_t{10} * 365 * 86'400 * kTicks, 0)) << "ten years";
}

TEST_F(SignedLink, AWrongSignatureDoesNotMoveTheClock) {
  Bytes frame = theirs(now_ + 3600 * kSigningTicksPerSecond);
  frame.back() ^= 1U;
  EXPECT_EQ(judged(frame), SignatureVerdict::wrong);
  EXPECT_EQ(time_.now(0), now_);
}

TEST(SigningTimestamp, CountsFrom2015) {
  EXPECT_EQ(signing_time_of(1'420'070'400'000'000), 0U);
  EXPECT_EQ(signing_time_of(1'420'070'400'000'010), 1U);
  EXPECT_EQ(signing_time_of(0), 0U);
  EXPECT_EQ(signing_time_of(kSigned_us),
            31'022'129'600'000U);  // date -d 2024-10-30T12:34:56Z +%s, less 2015's, by 10^5
}

TEST(SigningTimestamp, NoneIsEverReusedWhateverTheClocksDo) {
  const test::TemporaryFolder folder;
  const std::int64_t clocks[] = {kSigned_us, kSigned_us, kSigned_us - 86'400'000'000, 0, kSigned_us + 5};
  std::uint64_t last = 0;
  for (const std::int64_t unix_us : clocks) {  // each is a run that is killed
    SigningTime time(folder / "time", unix_us, 1000);
    for (const std::int64_t monotonic_us : {1000, 1000, 500, 25'000'000, 24'000'000, 60'000'000}) {
      const std::uint64_t taken = time.take(monotonic_us);
      EXPECT_GT(taken, last);
      last = taken;
    }
  }
}

TEST(SigningTimestamp, IsReservedBeforeItIsUsed) {
  const test::TemporaryFolder folder;
  SigningTime time(folder / "time", kSigned_us, 0);
  for (std::int64_t s = 0; s < 100; ++s) {
    const std::uint64_t taken = time.take(s * 1'000'000);
    EXPECT_GE(std::stoull(read_text_file(folder / "time")), taken);
  }
}

// Others refuse what is a minute late, and what has been used.
TEST(SigningTimestamp, StaysNearTheClockAndStrictlyIncreasingWithAndWithoutSave) {
  const test::TemporaryFolder folder;
  for (const bool kept : {false, true}) {
    SigningTime time(folder / (kept ? "kept" : "alone"), kSigned_us, 0);
    std::uint64_t last = 0;
    for (std::int64_t us = 0; us < 120'000'000; us += 50'000) {
      if (kept && us % 1'000'000 == 0) time.save(us);
      const std::uint64_t taken = time.take(us);
      ASSERT_GT(taken, last);
      ASSERT_LE(taken, time.now(us) + kSigningTicksPerSecond / 10);
      ASSERT_GE(taken + (kept ? 2 : 11) * kSigningTicksPerSecond, time.now(us));
      last = taken;
    }
  }
}

TEST(SigningTimestamp, MoreFramesThanReservedCauseANewReservation) {
  const test::TemporaryFolder folder;
  SigningTime time(folder / "time", kSigned_us, 0);
  std::uint64_t last = 0;
  for (int i = 0; i < 25'000; ++i) {
    const std::uint64_t taken = time.take(0);
    ASSERT_GT(taken, last);
    last = taken;
  }
  EXPECT_GE(std::stoull(read_text_file(folder / "time")), last);
}

// A service that crashes again and again must still accept an autopilot whose clock is right.
TEST(SigningTimestamp, ManyQuickRestartsDoNotRunAhead) {
  const test::TemporaryFolder folder;
  std::uint64_t last = 0;
  for (std::int64_t start = 0; start < 20; ++start) {
    const std::int64_t unix_us = kSigned_us + start * 200'000;
    SigningTime time(folder / "time", unix_us, 77);
    Signing signing(key(), time, 3);
    for (std::int64_t i = 0; i < 5; ++i) {
      const std::uint64_t taken = time.take(77 + i * 10'000);
      EXPECT_GT(taken, last);
      last = taken;
    }
    EXPECT_LE(time.now(77), signing_time_of(unix_us) + 3 * kSigningTicksPerSecond);
    // An autopilot half a minute behind is still accepted.
    const std::uint64_t theirs = signing_time_of(unix_us) - 30 * kSigningTicksPerSecond;
    FrameReader reader;
    reader.add(
        test::frames_by_pymavlink(kAttitude, "--key " + kSigningKeyHex + " --timestamp " + std::to_string(theirs))[0]);
    EXPECT_EQ(signing.check(*reader.next(), 77), SignatureVerdict::accepted);
  }
}

// The same when the autopilot adopts any time that it receives from us, and we adopt its time in turn.
TEST(SigningTimestamp, AnAutopilotThatAdoptsOurTimeCausesNoDrift) {
  const test::TemporaryFolder folder;
  std::uint64_t theirs = 0;
  std::int64_t unix_us = kSigned_us;
  for (int start = 0; start < 20; ++start, unix_us += 30'000'000) {  // killed twice a minute
    SigningTime time(folder / "time", unix_us, 0);
    for (std::int64_t us = 0; us < 30'000'000; us += 100'000) {
      if (us % 1'000'000 == 0) time.save(us);
      theirs = std::max(theirs + 10'000, time.take(us));
      time.adopt(theirs, us);
    }
    EXPECT_LE(time.now(30'000'000), signing_time_of(unix_us + 30'000'000) + 4 * kSigningTicksPerSecond);
  }
}

TEST(SigningTimestamp, AFullDiskIsCountedAndTheLinkContinues) {
  SigningTime time("/proc/no-such-folder/time", kSigned_us, 0);
  const std::uint64_t first = time.take(0);
  EXPECT_GT(time.take(0), first);
  EXPECT_EQ(time.failed_reservations(), 1U) << "one try, not one for each frame";
}

// Torn by a power cut: reported, and rewritten. The link starts with our clock and the peers' frames.
TEST(SigningTimestamp, ADamagedFileIsReportedAndReplaced) {
  const test::TemporaryFolder folder;
  const std::string whole = std::to_string(signing_time_of(kSigned_us)) + "\n";
  std::vector<std::string> texts{"\n", "12\n\n", "-1\n", "x\n", "99999999999999999\n", "1 2\n"};
  for (std::size_t size = 0; size < whole.size(); ++size) texts.push_back(whole.substr(0, size));
  for (const std::string& text : texts) {
    const auto path = folder.write("time", text);
    SigningTime time(path, kSigned_us, 0);
    EXPECT_NE(time.failure().find("damaged"), std::string::npos) << text;
    EXPECT_GE(time.take(0), signing_time_of(kSigned_us));
    time.save(1'000'000);
    EXPECT_EQ(time.failure(), "") << text;
    EXPECT_EQ(SigningTime(path, kSigned_us, 0).failure(), "") << text;
  }
  EXPECT_EQ(SigningTime(folder / "none", kSigned_us, 0).failure(), "") << "a new aircraft";
}

class KeyFile : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
};

TEST_F(KeyFile, IsWrittenForItsOwnerOnly) {
  const SigningKey made = SigningKey::generate();
  made.write(folder_ / "link.key");
  struct stat info {};
  ASSERT_EQ(::stat((folder_ / "link.key").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 07777, 0600U);
  EXPECT_EQ(SigningKey::read(folder_ / "link.key").bytes(), made.bytes());
  EXPECT_NE(SigningKey::generate().bytes(), made.bytes());
  EXPECT_THROW(made.write(folder_ / "link.key"), UsageError) << "an autopilot may still ask for it";
}

TEST_F(KeyFile, ReadableByOthersIsRejected) {
  const auto path = folder_.write("link.key", kSigningKeyHex + "\n");
  for (const mode_t mode : {0644U, 0640U, 0604U, 0602U}) {
    ::chmod(path.c_str(), mode);
    EXPECT_THROW(SigningKey::read(path), UsageError) << mode;
  }
  ::chmod(path.c_str(), 0400);
  EXPECT_EQ(SigningKey::read(path).bytes(), key().bytes());
}

TEST_F(KeyFile, ADamagedOneIsRejectedWithoutShowingIt) {
  for (const std::string& text : {std::string(), kSigningKeyHex.substr(1), kSigningKeyHex + "0", std::string(64, 'g'),
                                  kSigningKeyHex + "\n" + kSigningKeyHex, "  " + kSigningKeyHex}) {
    const auto path = folder_.write("link.key", text);
    ::chmod(path.c_str(), 0600);
    try {
      SigningKey::read(path);
      ADD_FAILURE() << text;
    } catch (const UsageError& error) {
      EXPECT_EQ(std::string(error.what()).find("0011"), std::string::npos);
    }
  }
  EXPECT_THROW(SigningKey::read(folder_ / "missing"), Error);
}

}  // namespace
}  // namespace nadir
