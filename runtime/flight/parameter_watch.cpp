#include "flight/parameter_watch.hpp"

#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

constexpr std::size_t kAtOnce = 3;  // with each heartbeat, one a second

// The wire has single precision.
bool same(double a, double b) { return std::abs(a - b) <= 1e-6 * std::max({1.0, std::abs(a), std::abs(b)}); }

}  // namespace

std::vector<OutgoingMessage> ParameterWatch::on_heartbeat(const Heartbeat& heartbeat) {
  encoding_ = parameter_encoding(heartbeat.autopilot);
  std::vector<OutgoingMessage> requests;
  if (heartbeat.armed) return requests;
  for (std::size_t i = 0; i < std::min(kAtOnce, expected_.size()); ++i) {
    requests.emplace_back(ParameterRequest{autopilot_, expected_[next_].name});
    next_ = (next_ + 1) % expected_.size();
  }
  return requests;
}

std::optional<ParameterChanged> ParameterWatch::on_message(const ParameterValue& value) {
  const auto expected = std::ranges::find(expected_, value.name, &AirframeParameter::name);
  if (expected == expected_.end()) return std::nullopt;
  const double found = value_of(value, encoding_);
  const auto before = different_.find(value.name);
  if (same(found, expected->value)) {
    if (before == different_.end()) return std::nullopt;
    different_.erase(before);
    return ParameterChanged{value.name, expected->value, expected->value};
  }
  if (before != different_.end() && same(before->second, found)) return std::nullopt;
  different_[value.name] = found;
  return ParameterChanged{value.name, expected->value, found};
}

}  // namespace nadir
