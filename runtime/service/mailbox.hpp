// The queue between two threads of the runtime: bounded, the latest wins. put() never waits and never fails; when the
// mailbox is full, the oldest item is dropped and counted. Frames go to the localizer through a mailbox of capacity
// one.
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
};

template <typename T>
class LatestMailbox {
 public:
  explicit LatestMailbox(std::size_t capacity = 1) : capacity_(capacity == 0 ? 1 : capacity) {}

  // After close() items are discarded.
  void put(T item) {
    std::optional<T> dropped;  // destroyed outside of the lock: frames are large
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

  // The oldest item, or nullopt at once.
  std::optional<T> try_take() {
    const std::scoped_lock lock(mutex_);
    return take_front();
  }

  // Waits for an item. nullopt: stop was requested, or the mailbox is closed and empty.
  std::optional<T> take(std::stop_token stop) {
    std::unique_lock lock(mutex_);
    filled_.wait(lock, std::move(stop), [&] { return !items_.empty() || closed_; });
    return take_front();
  }

  // The same, at most this long: so that an idle thread can still beat.
  std::optional<T> take_within(std::chrono::milliseconds at_most, std::stop_token stop) {
    std::unique_lock lock(mutex_);
    filled_.wait_for(lock, std::move(stop), at_most, [&] { return !items_.empty() || closed_; });
    return take_front();
  }

  // No more items. Those inside can still be taken.
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
