// The workers of one process: threads that judge tiles and let flights vote (tile_evaluation.hpp) for as long as there
// is something to do. On PostGIS each has a connection of its own, and other processes, on other machines too, may
// have more; on SpatiaLite they share the service's.
//
// Clients take turns, and within a client the upload that came first. Between a claim for verdicts and the next one
// comes a claim for votes, so that neither waits for the other.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "candidates/catalogue_thread.hpp"
#include "candidates/tile_evaluation.hpp"

namespace nadir {

struct WorkerCounts {
  std::uint64_t tiles = 0;      // with a verdict
  std::uint64_t addresses = 0;  // voted on
  std::uint64_t promoted = 0;
  std::uint64_t failures = 0;  // pieces of work that were not done
  double busy_s = 0;           // of all workers together
  double catalogue_s = 0;      // that they waited for connections of their own; 0 where they share one
};

class EvaluationWorkers {
 public:
  // evaluation, shared: must outlive this. shared: the catalogue of a process that has one for other things too; the
  // only one where it is a file. Throws Error when a connection cannot be opened.
  EvaluationWorkers(TileEvaluation& evaluation, const CatalogueLocation& location, CatalogueThread* shared,
                    int workers);
  ~EvaluationWorkers() { stop(); }
  EvaluationWorkers(const EvaluationWorkers&) = delete;
  EvaluationWorkers& operator=(const EvaluationWorkers&) = delete;

  void wake();        // something may be to be done: otherwise they look once a second
  void stop();        // what they are doing is finished
  bool idle() const;  // none of them found anything when it last looked

  // What went wrong last (the catalogue did not answer, a pack is damaged); empty: nothing. Such work stays to be done,
  // and is taken up after retry().
  std::string fault() const;
  void retry();

  WorkerCounts counts() const;

 private:
  struct Worker {
    CatalogueThread* catalogue = nullptr;
    std::string last_client{};  // whose turn it was
    bool idle = false;
    std::jthread thread{};  // last: it uses the others
  };
  void run(Worker& worker, const std::stop_token& stop);
  bool evaluate(Worker& worker, const std::stop_token& stop);
  bool vote(Worker& worker);
  template <typename Work>
  std::optional<TileEvaluation::Piece> attempt(std::int64_t what, const Work& work);
  bool resting(std::int64_t what) const;

  TileEvaluation& evaluation_;
  mutable std::mutex mutex_;
  std::condition_variable_any news_;
  std::uint64_t wakes_ = 0;
  std::set<std::int64_t> resting_;  // uploads with work that failed, until retry(); kVotes: the votes
  std::string fault_;
  WorkerCounts counts_;
  std::list<CatalogueThread> connections_;
  std::list<Worker> workers_;  // last: their threads use all of the above
};

}  // namespace nadir
