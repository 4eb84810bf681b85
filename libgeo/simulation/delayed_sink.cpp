#include "simulation/delayed_sink.hpp"

#include <utility>

namespace nadir {
namespace {

constexpr std::size_t kMostWaiting = 256;

}  // namespace

DelayedSink::DelayedSink(FrameSink& sink) : sink_(sink), thread_([this](const std::stop_token& stop) { run(stop); }) {}

DelayedSink::~DelayedSink() = default;

void DelayedSink::put(Bytes jpeg, std::int64_t unix_us, Moment due) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return failed_ || waiting_.size() < kMostWaiting; });
  throw_if_failed();
  waiting_.push_back({std::move(jpeg), unix_us, due});
  changed_.notify_all();
}

void DelayedSink::finish() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return failed_ || waiting_.empty(); });
  throw_if_failed();
}

int DelayedSink::handed_on() const {
  const std::scoped_lock lock(mutex_);
  return handed_on_;
}

void DelayedSink::throw_if_failed() const {
  if (failed_) std::rethrow_exception(failed_);
}

void DelayedSink::run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (changed_.wait(lock, stop, [&] { return !waiting_.empty(); })) {
    const Picture& next = waiting_.front();  // nobody else takes it, and a deque leaves it where it is
    changed_.wait_until(lock, stop, next.due, [] { return false; });
    if (stop.stop_requested()) return;
    lock.unlock();
    std::exception_ptr failed;
    try {
      sink_.put(next.jpeg, next.unix_us);
    } catch (...) {
      failed = std::current_exception();
    }
    lock.lock();
    failed_ = failed;
    if (!failed) ++handed_on_;
    waiting_.pop_front();
    changed_.notify_all();
    if (failed) return;
  }
}

}  // namespace nadir
