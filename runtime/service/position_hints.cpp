#include "service/position_hints.hpp"

#include <algorithm>

#include "service/service_rules.hpp"

namespace nadir {

HintAllowance::HintAllowance() : credit_(kHintBurst) {}

bool HintAllowance::take(double now_s) {
  credit_ = std::min<double>(kHintBurst, credit_ + std::max(0.0, now_s - credit_s_) / kHintPeriod_s);
  credit_s_ = now_s;
  if (credit_ < 1) return false;
  credit_ -= 1;
  return true;
}

bool HintRequest::due(double now_s, bool armed, bool has_position) {
  if (!armed || has_position) {
    lost_since_s_.reset();
    asked_s_.reset();
    return false;
  }
  if (!lost_since_s_) lost_since_s_ = now_s;
  const bool first = !asked_s_ && now_s - *lost_since_s_ >= kAskForHint_s;
  const bool again = asked_s_ && now_s - *asked_s_ >= kAskForHintAgain_s;
  if (!first && !again) return false;
  asked_s_ = now_s;
  return true;
}

}  // namespace nadir
