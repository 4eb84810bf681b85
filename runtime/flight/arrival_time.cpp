#include "flight/arrival_time.hpp"

#include <algorithm>
#include <variant>

namespace nadir {

void ArrivalTime::begin(double read_s, double delay_s) {
  began_s_ = read_s;
  least_s_ = delay_s;
}

double ArrivalTime::arrived_s(double last_look_s, double read_s, std::uint64_t stamp_us) {
  const double stamp_s = static_cast<double>(stamp_us) * 1e-6, delay_s = read_s - stamp_s;
  const auto least_s = [this] { return std::min(*least_s_, least_before_s_.value_or(*least_s_)); };
  if (!least_s_ || stamp_s < last_stamp_s_ - kMostDisorder_s || delay_s - least_s() > kMostDelay_s) {
    least_before_s_.reset();
    begin(read_s, delay_s);
    last_stamp_s_ = stamp_s;
  } else if (read_s - began_s_ > kLeastDelayOver_s) {
    least_before_s_ = least_s_;
    begin(read_s, delay_s);
  }
  last_stamp_s_ = std::max(last_stamp_s_, stamp_s);
  least_s_ = std::min(*least_s_, delay_s);
  return std::clamp(stamp_s + least_s(), std::min(last_look_s, read_s), read_s);
}

std::optional<std::uint64_t> stamp_us(const IncomingMessage& message) {
  std::uint64_t stamp = 0;
  if (const auto* imu = std::get_if<ImuSample>(&message)) stamp = imu->time_us;
  const auto boot = [&stamp](const auto* found) {
    if (found != nullptr) stamp = std::uint64_t{1000} * found->boot_ms;
  };
  boot(std::get_if<AircraftAttitude>(&message));
  boot(std::get_if<GimbalAttitude>(&message));
  boot(std::get_if<GlobalPosition>(&message));
  boot(std::get_if<GroundDistance>(&message));
  return stamp == 0 ? std::nullopt : std::optional(stamp);
}

}  // namespace nadir
