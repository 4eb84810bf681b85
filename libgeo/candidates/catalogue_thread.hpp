// The one thread that works with the catalogue, and the queue of what others want from it. A catalogue that fails is
// closed and opened anew for the next call: a server that comes back is found again.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <mutex>
#include <thread>
#include <type_traits>

#include "candidates/candidate_catalogue.hpp"

namespace nadir {

class CatalogueThread {
 public:
  // Opens it first, so that what is wrong shows now. Throws Error.
  CatalogueThread(CatalogueLocation location, CandidateCatalogue::Access access);
  ~CatalogueThread();
  CatalogueThread(const CatalogueThread&) = delete;
  CatalogueThread& operator=(const CatalogueThread&) = delete;

  // work(CandidateCatalogue&) in that thread; what it returns or throws comes back here.
  template <typename Work>
  std::invoke_result_t<Work, CandidateCatalogue&> call(Work work) {
    using Result = std::invoke_result_t<Work, CandidateCatalogue&>;
    const Waiting waiting(*this);
    std::promise<Result> promise;
    std::future<Result> result = promise.get_future();
    enqueue([&work, &promise](CandidateCatalogue* catalogue, std::exception_ptr failure) {
      try {
        if (failure) std::rethrow_exception(failure);
        if constexpr (std::is_void_v<Result>) {
          work(*catalogue);
          promise.set_value();
        } else {
          promise.set_value(work(*catalogue));
        }
        return true;
      } catch (...) {
        promise.set_exception(std::current_exception());
        return false;
      }
    });
    return result.get();
  }

  double waited_s() const { return static_cast<double>(waited_us_) / 1e6; }  // all callers together, for their answers

 private:
  class Waiting {
   public:
    explicit Waiting(CatalogueThread& thread) : thread_(thread) {}
    ~Waiting() {
      const auto taken = std::chrono::steady_clock::now() - begun_;
      thread_.waited_us_ += std::chrono::duration_cast<std::chrono::microseconds>(taken).count();
    }
    Waiting(const Waiting&) = delete;
    Waiting& operator=(const Waiting&) = delete;

   private:
    CatalogueThread& thread_;
    const std::chrono::steady_clock::time_point begun_ = std::chrono::steady_clock::now();
  };
  // Given the catalogue, or why there is none; false: it failed.
  using Job = std::function<bool(CandidateCatalogue*, std::exception_ptr)>;
  void enqueue(Job job);
  void run(const std::stop_token& stop);

  CatalogueLocation location_;
  CandidateCatalogue::Access access_;
  std::mutex mutex_;
  std::condition_variable_any news_;
  std::deque<Job> jobs_;
  std::atomic<std::int64_t> waited_us_ = 0;
  std::jthread thread_;  // last: it uses all of the above
};

}  // namespace nadir
