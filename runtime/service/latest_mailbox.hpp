// Between two threads: a bounded queue in which the latest wins. Who puts never waits and never fails; when it is full
// the oldest is dropped and counted. Pictures go to the localizer through one of these with room for one, records to
// the recorder through one with room for many.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <stop_token>
#include <utility>

namespace nadir {

struct MailboxCounts {
  std::uint64_t put = 0;
  std::uint64_t taken = 0;
  std::uint64_t dropped = 0;

  double dropped_share() const { return put == 0 ? 0 : static_cast<double>(dropped) / static_cast<double>(put); }
};

template <typename T>
class LatestMailbox {
 public:
  explicit LatestMailbox(std::size_t capacity = 1) : capacity_(capacity == 0 ? 1 : capacity) {}

  // After close() nothing goes in any more.
  void put(T item) {
    std::optional<T> dropped;  // destroyed outside of the lock: pictures are big
    {
      const std::scoped_lock lock(mutex_);
      if (closed_) return;
      if (items_.size() == capacity_) {
        dropped = std::move(items_.front());
        items_.pop_front();
        ++counts_.dropped;
      }
      items_.push_back(std::move(item));
      ++counts_.put;
    }
    filled_.notify_one();
  }

  // The oldest that is left, or nullopt at once.
  std::optional<T> try_take() {
    const std::scoped_lock lock(mutex_);
    return take_front();
  }

  // Waits for one. nullopt: stop was requested, or the box is closed and empty.
  std::optional<T> take(std::stop_token stop) {
    std::unique_lock lock(mutex_);
    filled_.wait(lock, std::move(stop), [&] { return !items_.empty() || closed_; });
    return take_front();
  }

  // The same, but not for longer than this: so that a thread with nothing to do can still say that it lives.
  std::optional<T> take_within(std::chrono::milliseconds at_most, std::stop_token stop) {
    std::unique_lock lock(mutex_);
    filled_.wait_for(lock, std::move(stop), at_most, [&] { return !items_.empty() || closed_; });
    return take_front();
  }

  // No more will come. What is in can still be taken.
  void close() {
    {
      const std::scoped_lock lock(mutex_);
      closed_ = true;
    }
    filled_.notify_all();
  }

  bool finished() const {
    const std::scoped_lock lock(mutex_);
    return closed_ && items_.empty();
  }

  MailboxCounts counts() const {
    const std::scoped_lock lock(mutex_);
    return counts_;
  }

 private:
  std::optional<T> take_front() {
    if (items_.empty()) return std::nullopt;
    std::optional<T> item(std::move(items_.front()));
    items_.pop_front();
    ++counts_.taken;
    return item;
  }

  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::condition_variable_any filled_;
  std::deque<T> items_;
  MailboxCounts counts_;
  bool closed_ = false;
};

}  // namespace nadir
