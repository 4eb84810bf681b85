#include "nadir_candidates/service_work.hpp"

#include <exception>

namespace nadir {

void ServiceWork::evaluate(const std::string& client, std::int64_t upload) {
  queue_.put_own("evaluate " + client, [this, client, upload] { evaluate_piece(client, upload); });
}

void ServiceWork::evaluate_piece(const std::string& client, std::int64_t upload) {
  try {
    if (service_.evaluate_some(upload)) return evaluate(client, upload);
  } catch (const std::exception& error) {
    failed(error.what());  // some tiles could not be read; the others are evaluated
  }
  vote();
}

void ServiceWork::vote() {
  if (voting_.exchange(true)) {
    again_ = true;
    return;
  }
  queue_.put_own("vote", [this] { vote_piece(); });
}

void ServiceWork::vote_piece() {
  try {
    again_ = false;
    if (service_.vote_some() || again_) {
      queue_.put_own("vote", [this] { vote_piece(); });
      return;
    }
  } catch (const std::exception& error) {
    failed(error.what());
  }
  voting_ = false;
  if (again_.exchange(false)) vote();
}

void ServiceWork::forget_expired() {
  queue_.put_own("forget", [this] {
    try {
      service_.forget_expired();
    } catch (const std::exception& error) {
      failed(error.what());
    }
  });
}

void ServiceWork::apply_revocations() {
  queue_.put_own("revocations", [this] {
    try {
      if (service_.apply_revocations() > 0) vote();
    } catch (const std::exception& error) {
      failed(error.what());
    }
  });
}

void ServiceWork::failed(const std::string& reason) {
  const std::lock_guard lock(mutex_);
  fault_ = reason;
}

std::string ServiceWork::fault() const {
  const std::lock_guard lock(mutex_);
  return fault_;
}

void ServiceWork::retry() {
  {
    const std::lock_guard lock(mutex_);
    if (fault_.empty()) return;
    fault_.clear();
  }
  queue_.put_own("retry", [this] {
    try {
      for (const auto& [client, upload] : service_.pending_evaluations()) evaluate(client, upload);
      vote();
    } catch (const std::exception& error) {
      failed(error.what());
    }
  });
}

}  // namespace nadir
