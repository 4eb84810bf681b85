// The service's own work, in turn with its callers': judging uploads that are complete, votes, forgetting what expired.
// Each piece is short and puts the next one at the end of its lane.
#pragma once

#include <atomic>
#include <string>

#include "candidates/candidate_service.hpp"
#include "candidates/fair_queue.hpp"

namespace nadir {

class ServiceWork {
 public:
  // Both must outlive this, and the queue must be stopped before it goes.
  ServiceWork(CandidateService& service, FairQueue& queue) : service_(service), queue_(queue) {}

  void judge(const std::string& client, std::int64_t upload);
  void vote();
  void forget_expired();
  void heed_revocations();

  // What went wrong last (the catalogue did not answer, a pack is damaged); empty: nothing. Such work stays to be done
  // and is taken up by retry().
  std::string trouble() const;
  void retry();

 private:
  void judge_piece(const std::string& client, std::int64_t upload);
  void vote_piece();
  void failed(const std::string& reason);

  CandidateService& service_;
  FairQueue& queue_;
  std::atomic<bool> voting_ = false, again_ = false;
  mutable std::mutex mutex_;
  std::string trouble_;
};

}  // namespace nadir
