// The clock of signatures: 10 µs since 2015-01-01 UTC, strictly increasing, never used twice, not even by the next run.
//
// The system's clock counts at the start alone; from there the time goes on with the monotonic clock, because a clock
// that is set back in flight must not silence the link. It also never falls behind what was accepted from others, which
// is how an aircraft without a clock learns the time. What a restart must not reuse is reserved in a file beforehand.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

namespace nadir {

inline constexpr std::uint64_t kSigningTicksPerSecond = 100'000;

// Zero before 2015.
std::uint64_t signing_time_of(std::int64_t unix_us);

class SigningTime {
 public:
  // path: the reservation; a file that does not exist is a new aircraft. monotonic_us is any steady clock's. Throws
  // Error when the file is damaged.
  SigningTime(std::filesystem::path path, std::int64_t unix_us, std::int64_t monotonic_us);

  // Ours at this moment, what others are measured by.
  std::uint64_t now(std::int64_t monotonic_us) const;

  // One for a signature. Nobody gets it again.
  std::uint64_t take(std::int64_t monotonic_us);

  // Somebody with the key is ahead.
  void adopt(std::uint64_t timestamp, std::int64_t monotonic_us);

  // Reservations that could not be written (a full disk): the link goes on, because an aircraft without it is worse off
  // than one whose next start has to rely on its clock.
  std::uint64_t failed_reservations() const { return failed_; }

 private:
  void reserve(std::uint64_t timestamp);

  std::filesystem::path path_;
  std::uint64_t base_ = 0;  // the time at base_us_
  std::int64_t base_us_ = 0;
  std::uint64_t last_ = 0;
  std::uint64_t reserved_ = 0;  // all below it may have been used
  std::uint64_t failed_ = 0;
};

}  // namespace nadir
