// The work of the service: a queue that is fair to its clients, and the service's own jobs in it.
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <functional>
#include <list>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "candidates/candidate_service.hpp"

namespace nadir {

// Jobs for a few threads. Each client has a lane of its own, and the lanes take turns: who asks for much only waits for
// himself. A lane never holds all threads at once.
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

// The service's own jobs, in turn with its clients': evaluating complete uploads, votes, removing what expired. Each
// piece is short and appends the next one to its lane.
class ServiceWork {
 public:
  // Both must outlive this, and the queue must be stopped before it goes.
  ServiceWork(CandidateService& service, FairQueue& queue) : service_(service), queue_(queue) {}

  void evaluate(const std::string& client, std::int64_t upload);
  void vote();
  void forget_expired();
  void apply_revocations();

  // What went wrong last (the catalogue did not answer, a pack is damaged); empty: nothing. Such work stays to be done
  // and is taken up by retry().
  std::string fault() const;
  void retry();

 private:
  void evaluate_piece(const std::string& client, std::int64_t upload);
  void vote_piece();
  void failed(const std::string& reason);

  CandidateService& service_;
  FairQueue& queue_;
  std::atomic<bool> voting_ = false, again_ = false;
  mutable std::mutex mutex_;
  std::string fault_;
};

}  // namespace nadir
