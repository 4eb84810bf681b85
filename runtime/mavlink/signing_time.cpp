#include "mavlink/signing_time.hpp"

#include <algorithm>
#include <charconv>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kEpochUnixUs = 1'420'070'400'000'000;  // 2015-01-01T00:00:00Z
constexpr std::uint64_t kLast = (std::uint64_t{1} << 48) - 1;

// Written this far ahead, and again when half of it is used: a restart jumps ahead by no more.
constexpr std::uint64_t kMargin = 20 * kSigningTicksPerSecond;

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
    : path_(std::move(path)), base_us_(monotonic_us), reserved_(read_reservation(path_)) {
  base_ = std::max(signing_time_of(unix_us), reserved_);
}

std::uint64_t SigningTime::now(std::int64_t monotonic_us) const {
  const std::int64_t elapsed_us = std::max<std::int64_t>(monotonic_us - base_us_, 0);
  return std::min(std::max(base_ + static_cast<std::uint64_t>(elapsed_us) / 10, last_), kLast);
}

std::uint64_t SigningTime::take(std::int64_t monotonic_us) {
  const std::uint64_t timestamp = std::min(std::max(now(monotonic_us), last_ + 1), kLast);
  if (timestamp + kMargin / 2 >= reserved_) reserve(timestamp);
  last_ = timestamp;
  return timestamp;
}

void SigningTime::adopt(std::uint64_t timestamp, std::int64_t monotonic_us) {
  if (timestamp <= now(monotonic_us)) return;
  base_ = timestamp;
  base_us_ = monotonic_us;
}

void SigningTime::reserve(std::uint64_t timestamp) {
  const std::uint64_t until = timestamp + kMargin;
  try {
    write_file_atomic(path_, std::to_string(until) + "\n");
  } catch (const Error&) {
    ++failed_;
  }
  reserved_ = until;  // also when it failed: the next try comes when half of it is used, not with every frame
}

}  // namespace nadir
