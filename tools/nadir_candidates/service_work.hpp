// The candidate service's own jobs, in turn with its clients' (http/fair_queue.hpp): removing what expired, withdrawing
// what revoked keys have signed. What judges tiles has threads of its own (candidates/evaluation_workers.hpp), and is
// waked from here.
#pragma once

#include <mutex>
#include <string>

#include "candidates/candidate_service.hpp"
#include "candidates/evaluation_workers.hpp"
#include "http/fair_queue.hpp"

namespace nadir {

class ServiceWork {
 public:
  // All must outlive this, and the queue must be stopped before it goes.
  ServiceWork(CandidateService& service, FairQueue& queue, EvaluationWorkers& workers)
      : service_(service), queue_(queue), workers_(workers) {}

  void forget_expired();
  void apply_revocations();

  // What went wrong last (the catalogue did not answer, a pack is damaged); empty: nothing. Such work stays to be done
  // and is taken up by retry().
  std::string fault() const;
  void retry();

 private:
  void failed(const std::string& reason);

  CandidateService& service_;
  FairQueue& queue_;
  EvaluationWorkers& workers_;
  mutable std::mutex mutex_;
  std::string fault_;
};

}  // namespace nadir
