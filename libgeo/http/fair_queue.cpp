#include "http/fair_queue.hpp"

#include <algorithm>

namespace nadir {

FairQueue::FairQueue(std::size_t threads, std::size_t places) : threads_count_(threads), places_(places) {
  for (std::size_t i = 0; i < threads; ++i) {
    threads_.emplace_back([this](const std::stop_token& stop) { run(stop); });
  }
}

void FairQueue::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  for (std::jthread& thread : threads_) thread.request_stop();
  threads_.clear();
  lanes_.clear();
}

FairQueue::Lane& FairQueue::lane_named(const std::string& name) {
  const auto found =
      std::find_if(lanes_.begin(), lanes_.end(), [&name](const Lane& lane) { return lane.name == name; });
  if (found != lanes_.end()) return *found;
  return lanes_.emplace_back(Lane{.name = name, .waiting = {}});
}

bool FairQueue::put(const std::string& name, Job job) {
  const std::lock_guard lock(mutex_);
  if (stopped_) return false;
  Lane& lane = lane_named(name);
  if (lane.waiting.size() >= places_) return false;
  lane.waiting.push_back(std::move(job));
  news_.notify_one();
  return true;
}

void FairQueue::put_own(const std::string& name, Job job) {
  const std::lock_guard lock(mutex_);
  if (stopped_) return;
  lane_named(name).waiting.push_back(std::move(job));
  news_.notify_one();
}

// The first lane with work that leaves a thread to others.
std::list<FairQueue::Lane>::iterator FairQueue::next_lane() {
  const std::size_t most = std::max<std::size_t>(1, threads_count_ - 1);
  return std::find_if(lanes_.begin(), lanes_.end(),
                      [most](const Lane& lane) { return !lane.waiting.empty() && lane.running < most; });
}

void FairQueue::run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  for (;;) {
    if (!news_.wait(lock, stop, [this] { return next_lane() != lanes_.end(); })) return;
    if (stopped_ || stop.stop_requested()) return;  // stop() asks the threads a moment after it says so
    const auto lane = next_lane();
    const Job job = std::move(lane->waiting.front());
    lane->waiting.pop_front();
    ++lane->running;
    lanes_.splice(lanes_.end(), lanes_, lane);
    lock.unlock();
    job();
    lock.lock();
    if (--lane->running == 0 && lane->waiting.empty()) lanes_.erase(lane);
    news_.notify_one();  // it may have been this lane's turn to wait
  }
}

}  // namespace nadir
