#include "flight/gps_fusion_switch.hpp"

#include <algorithm>
#include <string>
#include <string_view>

namespace nadir {
namespace {

constexpr std::string_view kParameter = "EKF2_GPS_CTRL";
constexpr std::uint8_t kInt32 = 6;  // MAV_PARAM_TYPE_INT32
constexpr double kRepeat_s = 0.5;   // until PX4 confirms
constexpr double kOff = 0;          // no bit: neither position, height nor velocity

}  // namespace

GpsFusionSwitch::GpsFusionSwitch(const std::vector<AirframeParameter>& provisioned, MavlinkAddress autopilot)
    : autopilot_(autopilot) {
  const auto known = std::ranges::find(provisioned, kParameter, &AirframeParameter::name);
  if (known != provisioned.end()) usual_ = known->value;
}

std::optional<OutgoingMessage> GpsFusionSwitch::turn(double now_s, GpsVerdict verdict) {
  if (verdict == GpsVerdict::denied || verdict == GpsVerdict::spoofed) off_ = changed_ = true;
  if (verdict == GpsVerdict::trusted) off_ = false;
  if (now_s < next_s_) return std::nullopt;
  if (!present_) {
    next_s_ = now_s + kRepeat_s;
    return ParameterRequest{autopilot_, std::string(kParameter)};
  }
  const double wanted = off_ ? kOff : usual_.value_or(*present_);
  if (*present_ == wanted || (!off_ && verdict != GpsVerdict::trusted)) return std::nullopt;
  next_s_ = now_s + kRepeat_s;
  return ParameterSet{autopilot_, std::string(kParameter), wire_value(wanted, kInt32, ParameterEncoding::bytewise),
                      kInt32};
}

bool GpsFusionSwitch::is_ours(const ParameterValue& value) const {
  return changed_ && value.name == kParameter && value_of(value, ParameterEncoding::bytewise) == kOff;
}

bool GpsFusionSwitch::is_off() const { return present_ && *present_ == kOff; }

std::optional<StatusText> GpsFusionSwitch::on_message(const ParameterValue& value) {
  if (value.name != kParameter) return std::nullopt;
  present_ = value_of(value, ParameterEncoding::bytewise);
  if (!usual_) usual_ = present_;
  if (!off_ && !is_off()) changed_ = false;
  const bool taken_out = is_off() && *usual_ != kOff;
  if (taken_out == told_off_) return std::nullopt;
  told_off_ = taken_out;
  return StatusText{TextSeverity::warning,
                    taken_out ? "Nadir: GPS taken out of PX4's filter" : "Nadir: GPS given back to PX4's filter"};
}

}  // namespace nadir
