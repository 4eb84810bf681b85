#include "nadir_candidates/service_work.hpp"

#include <exception>

namespace nadir {

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
      if (service_.apply_revocations() > 0) workers_.wake();
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
  return fault_.empty() ? workers_.fault() : fault_;
}

// Revocations and what expired come again by themselves.
void ServiceWork::retry() {
  {
    const std::lock_guard lock(mutex_);
    fault_.clear();
  }
  workers_.retry();
}

}  // namespace nadir
