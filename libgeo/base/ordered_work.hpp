// A parallel loop with ordered results: several threads work on numbered items, and the calling thread takes the
// results in the items' order. The outcome does not depend on the number of threads, and only a few results wait at a
// time.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <map>
#include <mutex>
#include <thread>
#include <vector>

namespace nadir {

// make_worker(): called once in each thread, returns a callable item -> Result that this thread alone uses.
// take(item, Result): called in the calling thread, in order; false stops the rest.
// The first exception of any of them ends the work and is thrown to the caller.
template <typename Result>
void work_in_order(std::size_t items, int threads,
                   const std::function<std::function<Result(std::size_t)>()>& make_worker,
                   const std::function<bool(std::size_t, Result)>& take) {
  std::mutex mutex;
  std::condition_variable changed;
  std::map<std::size_t, Result> ready;
  std::size_t next_item = 0, next_taken = 0;
  std::exception_ptr failure;
  bool stopped = false;
  const std::size_t ahead = static_cast<std::size_t>(std::max(1, threads)) * 2 + 1;

  const auto work = [&] {
    try {
      const auto worker = make_worker();
      while (true) {
        std::size_t item = 0;
        {
          std::unique_lock lock(mutex);
          changed.wait(lock, [&] { return stopped || next_item >= items || next_item < next_taken + ahead; });
          if (stopped || next_item >= items) return;
          item = next_item++;
        }
        Result result = worker(item);
        const std::lock_guard lock(mutex);
        ready.emplace(item, std::move(result));
        changed.notify_all();
      }
    } catch (...) {
      const std::lock_guard lock(mutex);
      if (!failure) failure = std::current_exception();
      stopped = true;
      changed.notify_all();
    }
  };

  std::vector<std::jthread> pool;
  for (int i = 0; i < std::max(1, threads); ++i) pool.emplace_back(work);
  try {
    while (next_taken < items) {
      std::unique_lock lock(mutex);
      changed.wait(lock, [&] { return stopped || ready.contains(next_taken); });
      if (stopped) break;
      auto node = ready.extract(next_taken);
      lock.unlock();
      const bool go_on = take(node.key(), std::move(node.mapped()));
      lock.lock();
      ++next_taken;
      if (!go_on) stopped = true;
      changed.notify_all();
    }
  } catch (...) {
    const std::lock_guard lock(mutex);
    if (!failure) failure = std::current_exception();
    stopped = true;
    changed.notify_all();
  }
  pool.clear();  // joins
  if (failure) std::rethrow_exception(failure);
}

}  // namespace nadir
