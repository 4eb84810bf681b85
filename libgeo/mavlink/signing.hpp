// MAVLink 2 message signing (mavlink.io/en/guide/message_signing.html): the key, the timestamps and the signatures of
// a link. A signature is the first 48 bits of
//   SHA-256(key ‖ header ‖ payload ‖ checksum ‖ link id ‖ timestamp)
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <tuple>

#include "mavlink/frame.hpp"

namespace nadir {

// The secret key of a link: 32 bytes, shared by the autopilot, its operators and this computer. It never enters a log,
// a record or an error text, and is wiped from memory on destruction.
class SigningKey {
 public:
  // A file with 64 hexadecimal digits, mode 0600 or narrower. Throws UsageError, Error.
  static SigningKey read(const std::filesystem::path& path);
  static SigningKey generate();  // from the operating system's randomness

  explicit SigningKey(const std::array<std::uint8_t, 32>& bytes) : bytes_(bytes) {}
  ~SigningKey();
  SigningKey(const SigningKey&) = default;
  SigningKey& operator=(const SigningKey&) = default;

  // Never replaces a file: it may hold a key that an autopilot still uses.
  void write(const std::filesystem::path& path) const;

  const std::array<std::uint8_t, 32>& bytes() const { return bytes_; }

 private:
  std::array<std::uint8_t, 32> bytes_;
};

inline constexpr std::uint64_t kSigningTicksPerSecond = 100'000;

// Timestamps count units of 10 µs since 2015-01-01 UTC. Zero before.
std::uint64_t signing_time_of(std::int64_t unix_us);

// The signing clock: strictly increasing timestamps that are never reused, not even by the next run.
//
// The system clock is read at the start only; from there the time advances with the monotonic clock, because a clock
// that is set back in flight must not silence the link. Neither the clock nor a peer is trusted without bounds:
//
//   adopt()   an accepted frame is ahead: we follow by at most a minute, in which frames of the right time are still
//             accepted. However many frames are ahead, the total is that minute.
//   follow()  a peer's frames show another time again and again (Signing): ours is set to it, forward or back. This
//             is how an aircraft without a battery-backed clock gets the time, and how a clock that runs ahead is
//             corrected. Never more than kMaxFollowed beyond the later of our clock and this program's release, and
//             never back behind what the file holds.
//
// now() is the time against which received frames are checked. take() returns timestamps at or slightly behind it: a
// file holds the highest timestamp that may have been used. A restart continues from the file until a frame
// of a peer is accepted: a clock that is wrong then moves no peer. What is written is at most a day ahead of our own
// clock, or of the file by the time that has passed, whatever was followed: the next start must not inherit a time that
// nothing confirms.
//
// save() writes the file, once a second, from a thread that may wait for disks. take() writes it only when nobody has
// called save() for ten seconds.
class SigningTime {
 public:
  // path: the file with the highest timestamp that may have been used; missing on a new aircraft. A damaged file counts
  // as missing, and failure() reports it. monotonic_us: of any steady clock.
  SigningTime(std::filesystem::path path, std::int64_t unix_us, std::int64_t monotonic_us);

  // The time against which received frames are checked.
  std::uint64_t now(std::int64_t monotonic_us) const;

  // A timestamp for one signature. Never waits for a concurrent save().
  std::uint64_t take(std::int64_t monotonic_us);

  // The latest time that a single frame may show.
  std::uint64_t latest(std::int64_t monotonic_us) const;

  // A frame of this time was accepted. answered: the latest timestamp of our answers to its sender (Signing), or 0; as
  // far as the minute permits, what take() returns from now on is later.
  void adopt(std::uint64_t timestamp, std::int64_t monotonic_us, std::uint64_t answered = 0);

  // The time is this one. False: out of bounds, and nothing has changed.
  bool follow(std::uint64_t timestamp, std::int64_t monotonic_us);

  // Reserves timestamps on disk. From any thread; as slow as the disk.
  void save(std::int64_t monotonic_us);

  // Failed writes (a full disk). The link continues: losing it in flight is worse than a next start that has to rely on
  // the system clock.
  std::uint64_t failed_reservations() const { return failed_; }

  // Why the file is not up to date: it was damaged, or could not be written. Empty after a successful save().
  std::string failure() const;

 private:
  std::string write(std::int64_t monotonic_us);
  std::uint64_t agreed(std::int64_t monotonic_us) const;
  std::uint64_t own(std::int64_t monotonic_us) const;
  std::uint64_t now_locked(std::int64_t monotonic_us) const;
  std::uint64_t outgoing(std::int64_t monotonic_us) const;

  const std::filesystem::path path_;
  std::atomic<std::uint64_t> failed_ = 0;

  std::mutex writing_;        // held while the file is written, so that an older value never replaces a newer one
  mutable std::mutex mutex_;  // guards all below
  std::string failure_;
  const std::uint64_t own_;  // by the system clock, at start_us_
  const std::int64_t start_us_;
  std::uint64_t held_ = 0;  // by the file at the start; 0: none
  std::uint64_t base_ = 0;  // the time at base_us_
  std::int64_t base_us_ = 0;
  std::uint64_t lead_ = 0;  // adopted beyond it
  bool peer_seen_ = false;
  std::uint64_t last_ = 0;     // returned by take()
  std::uint64_t allowed_ = 0;  // reserved in the file
};

// The last timestamp of each stream (system, component, link id): a frame whose stream has reached its timestamp is a
// replay. Kept in a file over restarts, or else everything that was recorded in the last minute could be replayed to a
// service that has just started. For any thread.
//
// The file holds timestamps kStreamReserve_us later than the last ones: what arrives between the last save and a crash
// counts as seen. A sender that continues to send is rejected for at most that long after a restart.
class StreamTimestamps {
 public:
  StreamTimestamps() = default;  // in memory alone

  // A missing file is a new aircraft. A damaged one counts as missing: fault() reports it, and the link continues.
  explicit StreamTimestamps(std::filesystem::path path);

  std::optional<std::uint64_t> last(const MavlinkAddress& source, std::uint8_t link_id) const;
  bool set(const MavlinkAddress& source, std::uint8_t link_id, std::uint64_t timestamp);  // false: too many streams

  // From a thread that may wait for disks; failures are counted. In flight once a second; at a clean end, when nothing
  // more is received, exactly the last ones.
  enum class When { in_flight, clean_end };
  void save(When when = When::in_flight);
  std::uint64_t failed_saves() const { return failed_; }
  const std::string& fault() const { return fault_; }

 private:
  using Stream = std::tuple<MavlinkAddress, std::uint8_t>;
  void read();

  std::filesystem::path path_;
  std::string fault_;
  std::atomic<std::uint64_t> failed_ = 0;
  mutable std::mutex mutex_;  // guards all below
  std::map<Stream, std::uint64_t> streams_;
  bool changed_ = false;
};

inline constexpr std::int64_t kStreamReserve_us = 1'500'000;

enum class SignatureVerdict { accepted, without, wrong, replayed, too_old, too_new, too_many_streams };

struct SignatureCounts {
  std::uint64_t accepted = 0;
  std::uint64_t without = 0;
  std::uint64_t wrong = 0;
  std::uint64_t replayed = 0;
  std::uint64_t too_old = 0;
  std::uint64_t too_new = 0;
  std::uint64_t too_many_streams = 0;
};

// Signs and verifies the frames of one link. Rejected are unsigned frames, wrong signatures, timestamps that their
// stream (system, component, link) has already reached, and timestamps more than a minute behind ours or two ahead.
//
// One of the two clocks may be wrong, and the autopilot's must count then: a companion computer without a battery that
// reboots in the air. So when nobody has sent an acceptable frame for three seconds (or ever), and one stream shows
// three frames over at least a second, none faster than time passes, our time follows it (SigningTime::follow()). A
// single frame, ten years ahead, changes nothing.
class Signing {
 public:
  // time must outlive this; the links of one aircraft share it. streams: of this link, must outlive this; null: in
  // memory.
  Signing(const SigningKey& key, SigningTime& time, std::uint8_t link_id, StreamTimestamps* streams = nullptr);

  // Signs an encoded version 2 frame, later than every answer: whoever received one rejects what is not.
  Bytes sign(Bytes frame, std::int64_t monotonic_us);

  // Signs the answer to a frame that was rejected as replayed, later than what its stream has reached: whoever sent it
  // and is alive takes over this time, and its next frame is not rejected. Our own time may be another one until then.
  Bytes sign_answer(Bytes frame, const MavlinkFrame& replayed, std::int64_t monotonic_us);

  SignatureVerdict check(const MavlinkFrame& frame, std::int64_t monotonic_us);

  const SignatureCounts& counts() const { return counts_; }

 private:
  using Stream = std::tuple<MavlinkAddress, std::uint8_t>;
  struct OtherTime {  // of a stream: a run of frames that are not of our time
    std::uint64_t first = 0, last = 0;
    std::int64_t first_us = 0;
    int frames = 0;
  };
  Bytes sign_at(Bytes frame, std::uint64_t timestamp) const;
  SignatureVerdict verdict(const MavlinkFrame& frame, std::int64_t monotonic_us);
  bool follows(const Stream& stream, std::uint64_t timestamp, std::int64_t monotonic_us);

  SigningKey key_;
  SigningTime& time_;
  std::uint8_t link_id_;
  std::unique_ptr<StreamTimestamps> own_streams_;  // unless they are somebody else's
  StreamTimestamps* streams_;
  std::map<Stream, OtherTime> other_times_;
  std::optional<std::int64_t> accepted_us_;  // when the last frame was
  std::optional<std::int64_t> answered_us_;  // when the first frame after that was answered
  std::uint64_t answered_ = 0;               // the latest timestamp of an answer, or of a frame that had to follow it
  SignatureCounts counts_;
};

}  // namespace nadir
