// The candidate service's own jobs, in turn with its clients' (http/fair_queue.hpp): evaluating complete uploads,
// votes, removing what expired. Each piece is short and appends the next one to its lane.
#pragma once

#include <atomic>
#include <mutex>
#include <string>

#include "candidates/candidate_service.hpp"
#include "http/fair_queue.hpp"

namespace nadir {

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
