#include "mavlink/signing_time.hpp"

#include <algorithm>
#include <charconv>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kEpochUnixUs = 1'420'070'400'000'000;  // 2015-01-01T00:00:00Z
constexpr std::uint64_t kLast = (std::uint64_t{1} << 48) - 1;

// So many may be given out until the file is written again. It is also how far a restart runs ahead at most.
constexpr std::uint64_t kAtOnce = kSigningTicksPerSecond / 10;

// Without anybody who calls keep(). What is given out falls behind by so much meanwhile, and a minute is too late.
constexpr std::uint64_t kLongestBehind = 10 * kSigningTicksPerSecond;

std::uint64_t read_reservation(const std::filesystem::path& path) {
  if (!std::filesystem::exists(path)) return 0;
  const std::string text = read_text_file(path, 64);
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || std::string_view(end) != "\n" || value > kLast) {
    throw Error({.what = "the memory of the signing time is damaged",
                 .where = path,
                 .expected = "one whole number: 10 µs since 2015",
                 .found = std::to_string(text.size()) + " other bytes",
                 .fix = "delete it if the system's clock is right; signatures could be replayed otherwise"});
  }
  return value;
}

}  // namespace

std::uint64_t signing_time_of(std::int64_t unix_us) {
  if (unix_us <= kEpochUnixUs) return 0;
  return std::min(static_cast<std::uint64_t>(unix_us - kEpochUnixUs) / 10, kLast);
}

SigningTime::SigningTime(std::filesystem::path path, std::int64_t unix_us, std::int64_t monotonic_us)
    : path_(std::move(path)), base_us_(monotonic_us), last_(read_reservation(path_)), allowed_(last_) {
  base_ = std::max(signing_time_of(unix_us), last_);
}

std::uint64_t SigningTime::now_locked(std::int64_t monotonic_us) const {
  const std::int64_t elapsed_us = std::max<std::int64_t>(monotonic_us - base_us_, 0);
  return std::min(base_ + static_cast<std::uint64_t>(elapsed_us) / 10, kLast);
}

std::uint64_t SigningTime::now(std::int64_t monotonic_us) const {
  const std::scoped_lock lock(mutex_);
  return now_locked(monotonic_us);
}

std::uint64_t SigningTime::take(std::int64_t monotonic_us) {
  {
    const std::scoped_lock lock(mutex_);
    if (last_ < allowed_ && now_locked(monotonic_us) < allowed_ + kLongestBehind) return ++last_;
  }
  if (const std::unique_lock writing(writing_, std::try_to_lock); writing) write(monotonic_us);
  const std::scoped_lock lock(mutex_);
  if (last_ >= allowed_ && last_ < kLast) ++failed_;  // another write hangs
  last_ = std::min(last_ + 1, kLast);
  return last_;
}

void SigningTime::adopt(std::uint64_t timestamp, std::int64_t monotonic_us) {
  const std::scoped_lock lock(mutex_);
  if (timestamp <= now_locked(monotonic_us)) return;
  base_ = timestamp;
  base_us_ = monotonic_us;
}

void SigningTime::keep(std::int64_t monotonic_us) {
  const std::scoped_lock writing(writing_);
  write(monotonic_us);
}

void SigningTime::write(std::int64_t monotonic_us) {
  std::uint64_t from = 0;
  {
    const std::scoped_lock lock(mutex_);
    from = std::max(now_locked(monotonic_us), allowed_);
  }
  const std::uint64_t until = std::min(from + kAtOnce, kLast);
  try {
    write_file_atomic(path_, std::to_string(until) + "\n");
  } catch (const Error&) {
    ++failed_;
  }
  // Also when it failed: the next try comes when this is used up or old, not with every frame.
  const std::scoped_lock lock(mutex_);
  last_ = std::max(last_, from);
  allowed_ = until;
}

}  // namespace nadir
