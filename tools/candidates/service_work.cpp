#include "candidates/service_work.hpp"

#include <exception>

namespace nadir {

void ServiceWork::judge(const std::string& client, std::int64_t upload) {
  queue_.put_own("judge " + client, [this, client, upload] { judge_piece(client, upload); });
}

void ServiceWork::judge_piece(const std::string& client, std::int64_t upload) {
  try {
    if (service_.judge_some(upload)) return judge(client, upload);
  } catch (const std::exception& error) {
    failed(error.what());  // some tiles could not be read; the others are judged
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

void ServiceWork::heed_revocations() {
  queue_.put_own("revocations", [this] {
    try {
      if (service_.heed_revocations() > 0) vote();
    } catch (const std::exception& error) {
      failed(error.what());
    }
  });
}

void ServiceWork::failed(const std::string& reason) {
  const std::lock_guard lock(mutex_);
  trouble_ = reason;
}

std::string ServiceWork::trouble() const {
  const std::lock_guard lock(mutex_);
  return trouble_;
}

void ServiceWork::retry() {
  {
    const std::lock_guard lock(mutex_);
    if (trouble_.empty()) return;
    trouble_.clear();
  }
  queue_.put_own("retry", [this] {
    try {
      for (const auto& [client, upload] : service_.to_judge()) judge(client, upload);
      vote();
    } catch (const std::exception& error) {
      failed(error.what());
    }
  });
}

}  // namespace nadir
