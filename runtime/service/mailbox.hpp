// How threads of the runtime hand things to each other: the latest wins, and put() never fails.
//
// LatestMailbox is a bounded queue whose reader can wait for an item. When it is full, the oldest item is dropped and
// counted. Its lock is held for as long as it takes to move one item. Frames go to the localizer through a mailbox of
// capacity one.
//
// LatestSlot is one value and no lock. It stands between the flight's threads and those of the API, which run at a
// lower priority: one of them, preempted while it held a mailbox's lock, would hold up the flight.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
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

// A value that was not taken is replaced. Neither side ever waits: a value changes hands in one atomic exchange.
template <typename Value>
class LatestSlot {
 public:
  LatestSlot() = default;
  ~LatestSlot() { delete value_.load(); }
  LatestSlot(const LatestSlot&) = delete;
  LatestSlot& operator=(const LatestSlot&) = delete;

  void put(Value value) { delete value_.exchange(new Value(std::move(value)), std::memory_order_acq_rel); }

  // Null when nothing has come since the last time.
  std::unique_ptr<Value> take() { return std::unique_ptr<Value>(value_.exchange(nullptr, std::memory_order_acq_rel)); }

 private:
  std::atomic<Value*> value_{nullptr};
};

}  // namespace nadir
