#include "mavlink/signing.hpp"

#include <openssl/crypto.h>
#include <openssl/rand.h>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <sstream>
#include <string>
#include <string_view>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kEpochUnix_us = 1'420'070'400'000'000;  // 2015-01-01T00:00:00Z
constexpr std::uint64_t kMaxTimestamp = (std::uint64_t{1} << 48) - 1;

// Timestamps reserved by each write of the file; a restart skips at most so many.
constexpr std::uint64_t kReservation = kSigningTicksPerSecond / 10;

// A frame of our time is at most so far behind it, and ahead: ArduPilot starts up to a minute ahead of its clock.
constexpr std::uint64_t kMaxAge = 60 * kSigningTicksPerSecond;
constexpr std::uint64_t kMaxAhead = 2 * kMaxAge;

// take() writes the file itself when timestamps lag by so much: nobody calls save(). Receivers reject a lag of a
// minute.
constexpr std::uint64_t kMaxLag = 10 * kSigningTicksPerSecond;

// A clock that is right shows no earlier time than this: 2026-01-01, the year of this program's release.
constexpr std::uint64_t kReleased = std::uint64_t{4018} * 86'400 * kSigningTicksPerSecond;

// How far beyond that a peer's time is followed, and how far beyond our own clock the file may be.
constexpr std::uint64_t kMaxFollowed = std::uint64_t{5} * 365 * 86'400 * kSigningTicksPerSecond;
constexpr std::uint64_t kMaxWrittenLead = std::uint64_t{86'400} * kSigningTicksPerSecond;

// Another time than ours is followed after so many frames of one stream, over so long, while nothing else was accepted.
constexpr int kFollowedFrames = 3;
constexpr std::int64_t kFollowedSpan_us = 1'000'000;
constexpr std::int64_t kSilence_us = 3'000'000;
constexpr std::uint64_t kJitter = kSigningTicksPerSecond;  // of a frame's way
constexpr std::size_t kMaxOtherTimes = 16;

std::uint64_t read_reservation(const std::filesystem::path& path) {
  if (!std::filesystem::exists(path)) return 0;
  const std::string text = read_text_file(path, 64);
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || std::string_view(end) != "\n" || value > kMaxTimestamp) {
    throw Error({.what = "the saved signing time is damaged",
                 .where = path,
                 .expected = "one integer: units of 10 µs since 2015",
                 .found = std::to_string(text.size()) + " bytes of other content",
                 .fix = "nothing: it is written anew; until then, frames recorded earlier can be replayed"});
  }
  return value;
}

constexpr std::size_t kTimestampSize = 6;
constexpr std::size_t kTagSize = 6;

// Only holders of the key can open streams; a fleet on one network stays far below.
constexpr std::size_t kMaxStreams = 1024;
constexpr std::uint64_t kMaxStreamsFile = 64 * kMaxStreams;
constexpr std::string_view kStreamsHeader = "nadir.signing-streams/1";

// signed_part: the frame up to and with the timestamp.
Sha256 digest(const SigningKey& key, ByteView signed_part) {
  Sha256Stream stream;
  stream.update(key.bytes());
  stream.update(signed_part);
  return stream.finish();
}

}  // namespace

SigningKey::~SigningKey() { OPENSSL_cleanse(bytes_.data(), bytes_.size()); }

SigningKey SigningKey::read(const std::filesystem::path& path) {
  require_private_mode(path);
  std::string text = read_text_file(path, 1024);
  std::string_view digits = text;
  while (digits.ends_with('\n') || digits.ends_with('\r')) digits.remove_suffix(1);
  auto bytes = Sha256::from_hex(digits);  // 32 bytes as well
  OPENSSL_cleanse(text.data(), text.size());
  if (!bytes) {
    throw UsageError(
        {.what = "the file contains no signing key",
         .where = path,
         .expected = "64 lower-case hexadecimal digits and nothing else",
         .found = "different content (not shown: it may be a secret)",
         .fix = "create a key with `openssl rand -hex 32` and install it with `nadir provision autopilot`"});
  }
  SigningKey key(bytes->bytes);
  OPENSSL_cleanse(bytes->bytes.data(), bytes->bytes.size());
  return key;
}

SigningKey SigningKey::generate() {
  std::array<std::uint8_t, 32> bytes{};
  if (RAND_priv_bytes(bytes.data(), static_cast<int>(bytes.size())) != 1) {
    throw Error({.what = "cannot create a signing key",
                 .found = "the operating system provides no random numbers",
                 .fix = "try again; right after the start of a computer they may not be ready yet"});
  }
  return SigningKey(bytes);
}

void SigningKey::write(const std::filesystem::path& path) const {
  std::string text = Sha256{bytes_}.hex() + "\n";
  const bool created = PendingFile(path, as_bytes(text), 0600).create();
  OPENSSL_cleanse(text.data(), text.size());
  if (created) return;
  throw UsageError({.what = "a signing key already exists",
                    .where = path,
                    .expected = "a path that does not exist",
                    .fix = "move it away; an autopilot may still use it"});
}

std::uint64_t signing_time_of(std::int64_t unix_us) {
  if (unix_us <= kEpochUnix_us) return 0;
  return std::min(static_cast<std::uint64_t>(unix_us - kEpochUnix_us) / 10, kMaxTimestamp);
}

SigningTime::SigningTime(std::filesystem::path path, std::int64_t unix_us, std::int64_t monotonic_us)
    : path_(std::move(path)), own_(signing_time_of(unix_us)), start_us_(monotonic_us), base_us_(monotonic_us) {
  try {
    held_ = read_reservation(path_);
  } catch (const std::exception& error) {
    failure_ = error.what();
  }
  last_ = allowed_ = held_;
  base_ = std::max(own_, held_);
}

namespace {

std::uint64_t ticks_between(std::int64_t from_us, std::int64_t to_us) {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(to_us - from_us, 0)) / 10;
}

}  // namespace

std::uint64_t SigningTime::own(std::int64_t monotonic_us) const {
  return std::min(own_ + ticks_between(start_us_, monotonic_us), kMaxTimestamp);
}

std::uint64_t SigningTime::agreed(std::int64_t monotonic_us) const {
  return std::min(base_ + ticks_between(base_us_, monotonic_us), kMaxTimestamp);
}

std::uint64_t SigningTime::now_locked(std::int64_t monotonic_us) const {
  return std::min(agreed(monotonic_us) + lead_, kMaxTimestamp);
}

// Until a frame of a peer has been accepted our clock may be wrong: timestamps continue from the last run's, and no
// peer's clock is moved.
std::uint64_t SigningTime::outgoing(std::int64_t monotonic_us) const {
  if (peer_seen_ || held_ == 0) return now_locked(monotonic_us);
  return std::min(held_ + ticks_between(start_us_, monotonic_us), now_locked(monotonic_us));
}

std::uint64_t SigningTime::latest(std::int64_t monotonic_us) const {
  const std::scoped_lock lock(mutex_);
  return std::min(agreed(monotonic_us) + kMaxAhead, kMaxTimestamp);
}

std::string SigningTime::failure() const {
  const std::scoped_lock lock(mutex_);
  return failure_;
}

std::uint64_t SigningTime::now(std::int64_t monotonic_us) const {
  const std::scoped_lock lock(mutex_);
  return now_locked(monotonic_us);
}

std::uint64_t SigningTime::take(std::int64_t monotonic_us) {
  {
    const std::scoped_lock lock(mutex_);
    if (last_ < allowed_ && outgoing(monotonic_us) < allowed_ + kMaxLag) return ++last_;
  }
  if (const std::unique_lock writing(writing_, std::try_to_lock); writing) write(monotonic_us);
  const std::scoped_lock lock(mutex_);
  if (last_ >= allowed_ && last_ < kMaxTimestamp) ++failed_;  // another write is blocked
  last_ = std::min(last_ + 1, kMaxTimestamp);
  return last_;
}

void SigningTime::adopt(std::uint64_t timestamp, std::int64_t monotonic_us, std::uint64_t answered) {
  const std::scoped_lock lock(mutex_);
  peer_seen_ = true;
  bool leaps =
      last_ < answered;  // also where our clock has passed the answer: what take() returns is reserved behind it
  const std::uint64_t latest = std::max(timestamp, answered);
  if (latest > now_locked(monotonic_us)) {
    const std::uint64_t lead = std::min(latest - agreed(monotonic_us), kMaxAge);
    leaps = leaps || lead > lead_ + kReservation;
    lead_ = lead;
  }
  if (leaps) allowed_ = last_;  // the next frame that we sign is there, and not only after the next save()
}

bool SigningTime::follow(std::uint64_t timestamp, std::int64_t monotonic_us) {
  const std::scoped_lock lock(mutex_);
  if (timestamp > std::max(own(monotonic_us), kReleased) + kMaxFollowed || timestamp + kMaxAge < held_) return false;
  base_ = timestamp;
  base_us_ = monotonic_us;
  lead_ = 0;
  peer_seen_ = true;
  return true;
}

void SigningTime::save(std::int64_t monotonic_us) {
  const std::scoped_lock writing(writing_);
  std::string failure = write(monotonic_us);
  const std::scoped_lock lock(mutex_);
  failure_ = std::move(failure);
}

// Why not; empty when it is written.
std::string SigningTime::write(std::int64_t monotonic_us) {
  std::uint64_t from = 0, bound = 0;
  {
    const std::scoped_lock lock(mutex_);
    from = std::max(outgoing(monotonic_us), allowed_);
    const std::uint64_t since_held = held_ + ticks_between(start_us_, monotonic_us) + kSigningTicksPerSecond;
    bound = std::max(own(monotonic_us) + kMaxWrittenLead, since_held);
  }
  const std::uint64_t until = std::min(from + kReservation, kMaxTimestamp);
  std::string failure;
  try {
    write_file_atomic(path_, std::to_string(std::min(until, bound)) + "\n");
  } catch (const std::exception& error) {
    ++failed_;
    failure = error.what();
  }
  // Also after a failure: the next attempt comes when this reservation is used up or old, not with every frame.
  const std::scoped_lock lock(mutex_);
  last_ = std::max(last_, from);
  allowed_ = until;
  return failure;
}

// ---- StreamTimestamps: "nadir.signing-streams/1", then a line "system component link timestamp" for each

StreamTimestamps::StreamTimestamps(std::filesystem::path path) : path_(std::move(path)) {
  try {
    read();
  } catch (const Error& error) {
    streams_.clear();
    fault_ = error.what();
  }
}

void StreamTimestamps::read() {
  if (!std::filesystem::exists(path_)) return;
  const std::string text = read_text_file(path_, kMaxStreamsFile);
  const auto damaged = [&](const std::string& found) {
    return Error({.what = "the saved timestamps of signed streams are damaged",
                  .where = path_,
                  .expected = std::string(kStreamsHeader) + " and four integers in each line",
                  .found = found,
                  .fix = "nothing: they are collected anew; for a minute, recorded frames can be replayed"});
  };
  std::istringstream lines(text);
  std::string line;
  if (!text.ends_with('\n') || !std::getline(lines, line) || line != kStreamsHeader)
    throw damaged("another beginning or end");
  while (std::getline(lines, line)) {
    unsigned system = 0, component = 0, link = 0;
    unsigned long long timestamp = 0;
    int used = 0;
    const int fields = std::sscanf(line.c_str(), "%3u %3u %3u %15llu%n", &system, &component, &link, &timestamp, &used);
    if (fields != 4 || static_cast<std::size_t>(used) != line.size() || system > 255 || component > 255 || link > 255 ||
        timestamp > kMaxTimestamp || streams_.size() >= kMaxStreams) {
      throw damaged("line " + std::to_string(streams_.size() + 2));
    }
    const MavlinkAddress source{static_cast<std::uint8_t>(system), static_cast<std::uint8_t>(component)};
    streams_[{source, static_cast<std::uint8_t>(link)}] = timestamp;
  }
}

std::optional<std::uint64_t> StreamTimestamps::last(const MavlinkAddress& source, std::uint8_t link_id) const {
  const std::scoped_lock lock(mutex_);
  const auto known = streams_.find({source, link_id});
  return known == streams_.end() ? std::nullopt : std::optional(known->second);
}

bool StreamTimestamps::set(const MavlinkAddress& source, std::uint8_t link_id, std::uint64_t timestamp) {
  const std::scoped_lock lock(mutex_);
  const Stream stream{source, link_id};
  if (streams_.size() >= kMaxStreams && !streams_.contains(stream)) return false;
  streams_[stream] = timestamp;
  changed_ = true;
  return true;
}

void StreamTimestamps::save(When when) {
  const std::uint64_t reserve = when == When::in_flight ? kStreamReserve_us / 10 : 0;
  std::string text(kStreamsHeader);
  text += '\n';
  {
    const std::scoped_lock lock(mutex_);
    // What was saved in flight is later than the last ones.
    if (path_.empty() || streams_.empty() || (when == When::in_flight && !changed_)) return;
    for (const auto& [stream, timestamp] : streams_) {
      const auto& [source, link_id] = stream;
      const std::uint64_t reserved = std::min(timestamp + reserve, kMaxTimestamp);
      text += std::to_string(source.system) + ' ' + std::to_string(source.component) + ' ' + std::to_string(link_id) +
              ' ' + std::to_string(reserved) + '\n';
    }
    changed_ = false;
  }
  try {
    write_file_atomic(path_, text);
  } catch (const Error&) {
    ++failed_;
    const std::scoped_lock lock(mutex_);
    changed_ = true;
  }
}

Signing::Signing(const SigningKey& key, SigningTime& time, std::uint8_t link_id, StreamTimestamps* streams)
    : key_(key),
      time_(time),
      link_id_(link_id),
      own_streams_(streams != nullptr ? nullptr : std::make_unique<StreamTimestamps>()),
      streams_(streams != nullptr ? streams : own_streams_.get()) {}

Bytes Signing::sign(Bytes frame, std::int64_t monotonic_us) {
  std::uint64_t timestamp = time_.take(monotonic_us);
  if (timestamp <= answered_) timestamp = answered_ = std::min(answered_ + 1, kMaxTimestamp);
  return sign_at(std::move(frame), timestamp);
}

Bytes Signing::sign_answer(Bytes frame, const MavlinkFrame& replayed, std::int64_t monotonic_us) {
  if (!answered_us_) answered_us_ = monotonic_us;
  const std::uint8_t stream = replayed.bytes[replayed.bytes.size() - kSignatureSize];
  const std::uint64_t reached = streams_->last(replayed.source, stream).value_or(0);
  const std::uint64_t later = reached + 1 + ticks_between(*answered_us_, monotonic_us);
  answered_ = std::min(std::max({time_.take(monotonic_us), later, answered_ + 1}), kMaxTimestamp);
  return sign_at(std::move(frame), answered_);
}

Bytes Signing::sign_at(Bytes frame, std::uint64_t timestamp) const {
  mark_signed(frame);
  frame.push_back(link_id_);
  for (std::size_t i = 0; i < kTimestampSize; ++i) frame.push_back(static_cast<std::uint8_t>(timestamp >> (8 * i)));
  const Sha256 tag = digest(key_, frame);
  frame.insert(frame.end(), tag.bytes.begin(), tag.bytes.begin() + kTagSize);
  return frame;
}

SignatureVerdict Signing::verdict(const MavlinkFrame& frame, std::int64_t monotonic_us) {
  if (!frame.has_signature) return SignatureVerdict::without;
  const ByteView all = frame.bytes;
  const ByteView tag = all.last(kTagSize);
  if (CRYPTO_memcmp(digest(key_, all.first(all.size() - kTagSize)).bytes.data(), tag.data(), kTagSize) != 0) {
    return SignatureVerdict::wrong;
  }
  const ByteView block = all.last(kSignatureSize);
  std::uint64_t timestamp = 0;
  for (std::size_t i = kTimestampSize; i > 0; --i) timestamp = (timestamp << 8) | block[i];

  const Stream stream{frame.source, block[0]};
  const auto last = streams_->last(frame.source, block[0]);
  if (last && timestamp <= *last) return SignatureVerdict::replayed;
  const bool too_old = timestamp + kMaxAge < time_.now(monotonic_us);
  if ((too_old || timestamp > time_.latest(monotonic_us)) && !follows(stream, timestamp, monotonic_us)) {
    return too_old ? SignatureVerdict::too_old : SignatureVerdict::too_new;
  }
  if (!streams_->set(frame.source, block[0], timestamp)) return SignatureVerdict::too_many_streams;
  time_.adopt(timestamp, monotonic_us, answered_us_ ? answered_ : 0);
  accepted_us_ = monotonic_us;
  answered_us_.reset();
  other_times_.clear();
  return SignatureVerdict::accepted;
}

// A frame that is not of our time: does ours follow it?
bool Signing::follows(const Stream& stream, std::uint64_t timestamp, std::int64_t monotonic_us) {
  if (accepted_us_ && monotonic_us - *accepted_us_ < kSilence_us) return false;
  if (!other_times_.contains(stream) && other_times_.size() >= kMaxOtherTimes) other_times_.clear();
  OtherTime& other = other_times_[stream];
  const bool in_step = other.frames > 0 && timestamp > other.last &&
                       timestamp - other.first <= ticks_between(other.first_us, monotonic_us) + kJitter;
  if (!in_step) {
    other = {timestamp, timestamp, monotonic_us, 1};
    return false;
  }
  other.last = timestamp;
  ++other.frames;
  if (other.frames < kFollowedFrames || monotonic_us - other.first_us < kFollowedSpan_us) return false;
  return time_.follow(timestamp, monotonic_us);
}

SignatureVerdict Signing::check(const MavlinkFrame& frame, std::int64_t monotonic_us) {
  const SignatureVerdict result = verdict(frame, monotonic_us);
  switch (result) {
    case SignatureVerdict::accepted: ++counts_.accepted; break;
    case SignatureVerdict::without: ++counts_.without; break;
    case SignatureVerdict::wrong: ++counts_.wrong; break;
    case SignatureVerdict::replayed: ++counts_.replayed; break;
    case SignatureVerdict::too_old: ++counts_.too_old; break;
    case SignatureVerdict::too_new: ++counts_.too_new; break;
    case SignatureVerdict::too_many_streams: ++counts_.too_many_streams; break;
  }
  return result;
}

}  // namespace nadir
