// The clock of signatures: 10 µs since 2015-01-01 UTC, strictly increasing, never used twice, not even by the next run.
//
// The system's clock counts at the start alone; from there the time goes on with the monotonic clock, because a clock
// that is set back in flight must not silence the link. It also never falls behind what was accepted from others, which
// is how an aircraft without a clock learns the time.
//
// Two times are kept apart. now() is what frames of others are judged by. What take() gives out lies at or a little
// behind it: a file says how far timestamps may have been used, and it says no more than now() and a tenth of a second.
// So a restart continues where the file ends without running ahead of anybody's clock, however often it happens.
//
// The file is written by keep(), which whoever has time for disks calls once a second. take() writes only when nobody
// has done so for ten.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <mutex>

namespace nadir {

inline constexpr std::uint64_t kSigningTicksPerSecond = 100'000;

// Zero before 2015.
std::uint64_t signing_time_of(std::int64_t unix_us);

class SigningTime {
 public:
  // path: how far timestamps may have been used; a file that does not exist is a new aircraft. monotonic_us is any
  // steady clock's. Throws Error when the file is damaged.
  SigningTime(std::filesystem::path path, std::int64_t unix_us, std::int64_t monotonic_us);

  // Ours at this moment, what others are measured by.
  std::uint64_t now(std::int64_t monotonic_us) const;

  // One for a signature. Nobody gets it again. Never waits for a keep() that is going on.
  std::uint64_t take(std::int64_t monotonic_us);

  // Somebody with the key is ahead.
  void adopt(std::uint64_t timestamp, std::int64_t monotonic_us);

  // Writes how far timestamps may be used from now on. From any thread; as slow as the disk.
  void keep(std::int64_t monotonic_us);

  // Times that it could not be written (a full disk): the link goes on, because an aircraft without it is worse off
  // than one whose next start has to rely on its clock.
  std::uint64_t failed_reservations() const { return failed_; }

 private:
  void write(std::int64_t monotonic_us);
  std::uint64_t now_locked(std::int64_t monotonic_us) const;

  const std::filesystem::path path_;
  std::atomic<std::uint64_t> failed_ = 0;

  std::mutex writing_;        // held while the file is written: an older number never replaces a newer one
  mutable std::mutex mutex_;  // guards all below
  std::uint64_t base_ = 0;    // the time at base_us_
  std::int64_t base_us_ = 0;
  std::uint64_t last_ = 0;     // given out
  std::uint64_t allowed_ = 0;  // all up to here may be given out: the file says so
};

}  // namespace nadir
