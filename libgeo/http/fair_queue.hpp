// Jobs for the few threads of a service, fair to its clients.
//
// Each client has a lane of its own, and the lanes take turns: who asks for much only waits for himself. A lane never
// holds all threads at once.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <list>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace nadir {

class FairQueue {
 public:
  using Job = std::function<void()>;  // must not throw

  FairQueue(std::size_t threads, std::size_t places);  // places: of a lane
  ~FairQueue() { stop(); }
  FairQueue(const FairQueue&) = delete;
  FairQueue& operator=(const FairQueue&) = delete;

  // What runs ends; what waits, and what comes from now on, is dropped.
  void stop();

  // false: the lane is full, the job was not taken.
  bool put(const std::string& lane, Job job);
  // The service's own work: goes in whatever waits there.
  void put_own(const std::string& lane, Job job);

 private:
  struct Lane {
    std::string name;
    std::deque<Job> waiting;
    std::size_t running = 0;
  };
  void run(const std::stop_token& stop);
  Lane& lane_named(const std::string& name);
  std::list<Lane>::iterator next_lane();

  const std::size_t threads_count_, places_;
  std::mutex mutex_;
  std::condition_variable_any news_;
  std::list<Lane> lanes_;  // the first is next; a lane without work is none
  bool stopped_ = false;
  std::vector<std::jthread> threads_;
};

}  // namespace nadir
