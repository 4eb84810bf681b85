// The one thread that works with the catalogue, and the queue of what others want from it. A catalogue that fails is
// closed and opened anew for the next call: a server that comes back is found again.
#pragma once

#include <condition_variable>
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

 private:
  // Given the catalogue, or why there is none; false: it failed.
  using Job = std::function<bool(CandidateCatalogue*, std::exception_ptr)>;
  void enqueue(Job job);
  void run(const std::stop_token& stop);

  CatalogueLocation location_;
  CandidateCatalogue::Access access_;
  std::mutex mutex_;
  std::condition_variable_any news_;
  std::deque<Job> jobs_;
  std::jthread thread_;  // last: it uses all of the above
};

}  // namespace nadir
