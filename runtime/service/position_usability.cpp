#include "service/position_usability.hpp"

#include "service/service_rules.hpp"

namespace nadir {

PositionUsability::Change PositionUsability::update(double now_s, const std::optional<double>& hpl_m) {
  const bool within = hpl_m && *hpl_m >= 0 && *hpl_m <= alert_limit_m_;  // false for NaN
  if (!within) {
    within_since_s_.reset();
    if (!left_s_) left_s_ = now_s;
    if (alerted_ || now_s - *left_s_ < kAlertShare * time_to_alert_s_) return Change::none;
    alerted_ = true;
    return Change::lost;
  }
  if (!within_since_s_) within_since_s_ = now_s;
  if (now_s - *within_since_s_ < time_to_alert_s_) return Change::none;
  left_s_.reset();
  if (!alerted_) return Change::none;
  alerted_ = false;
  return Change::regained;
}

}  // namespace nadir
