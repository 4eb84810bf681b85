#include "flight/parameter_watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "mavlink/commands.hpp"
#include "service/service_rules.hpp"

namespace nadir {
namespace {

constexpr std::size_t kAtOnce = 3;      // with each heartbeat, one a second
constexpr int kUnanswered = 5;          // requests, until a parameter is missing
constexpr int kSilentHeartbeats = 60;   // until all are
constexpr int kVersionHeartbeats = 10;  // between two requests of a version that is known

// The wire has single precision.
bool same(double a, double b) { return std::abs(a - b) <= 1e-6 * std::max({1.0, std::abs(a), std::abs(b)}); }

// docs/px4.md: what nadir provision sets from 1.18 on, and before.
std::optional<bool> made_for_global_position(const std::vector<AirframeParameter>& parameters) {
  for (const AirframeParameter& parameter : parameters) {
    if (parameter.name.starts_with("EKF2_AGP")) return true;
    if (parameter.name.starts_with("EKF2_EV_")) return false;
  }
  return std::nullopt;
}

}  // namespace

ParameterWatch::ParameterWatch(const std::vector<AirframeParameter>& expected, MavlinkAddress autopilot)
    : autopilot_(autopilot), made_for_global_position_(made_for_global_position(expected)) {
  for (const AirframeParameter& parameter : expected) parameters_.push_back({.expected = parameter});
}

ParameterWatch::Turn ParameterWatch::on_heartbeat(double now_s, const Heartbeat& heartbeat) {
  encoding_ = parameter_encoding(heartbeat.autopilot);
  if (heartbeat_s_ && now_s - *heartbeat_s_ > kLinkLost_s) forget_requests();
  heartbeat_s_ = now_s;
  Turn turn;
  const bool px4 = heartbeat.autopilot == AutopilotType::px4;
  if (px4 && made_for_global_position_ && (!heartbeat.armed || !version_) && --heartbeats_until_version_ < 0) {
    turn.requests.push_back(request_message(autopilot_, StreamedMessage::autopilot_version));
    heartbeats_until_version_ = version_ ? kVersionHeartbeats - 1 : 0;
  }
  std::size_t asked = 0;
  for (std::size_t i = 0; i < parameters_.size() && asked < kAtOnce; ++i) {
    Watched& parameter = parameters_[next_];
    next_ = (next_ + 1) % parameters_.size();
    const bool wanted = !heartbeat.armed || !parameter.known;
    if (wanted) {
      ask(parameter);
      turn.requests.emplace_back(ParameterRequest{autopilot_, parameter.expected.name});
      ++asked;
    }
    if (next_ == 0 && !turn.missing) turn.missing = newly_missing();
  }
  if (asked > 0) ++silent_heartbeats_;
  return turn;
}

void ParameterWatch::ask(Watched& parameter) {
  if (parameter.asked && *parameter.asked < answered_) ++parameter.unanswered;
  parameter.asked = ++requests_;
}

void ParameterWatch::forget_requests() {
  for (Watched& parameter : parameters_) {
    parameter.asked.reset();
    parameter.unanswered = 0;
  }
  silent_heartbeats_ = 0;
}

std::optional<ParametersMissing> ParameterWatch::newly_missing() {
  if (wrong_version()) return std::nullopt;
  // What vanished together is reported together: not before one that is still in question is decided.
  const auto in_question = [](const Watched& one) {
    return !one.missing && one.unanswered > 0 && one.unanswered < kUnanswered;
  };
  const auto overdue = [](const Watched& one) { return !one.missing && one.unanswered >= 2 * kUnanswered; };
  const bool all = silent_heartbeats_ >= kSilentHeartbeats;
  if (!all && std::ranges::any_of(parameters_, in_question) && std::ranges::none_of(parameters_, overdue)) {
    return std::nullopt;
  }
  ParametersMissing missing{.names = {}, .all = all};
  for (Watched& parameter : parameters_) {
    if (parameter.missing || (!all && parameter.unanswered < kUnanswered)) continue;
    parameter.missing = true;
    missing.names.push_back(parameter.expected.name);
  }
  if (missing.names.empty()) return std::nullopt;
  return missing;
}

std::optional<ParameterChanged> ParameterWatch::on_message(const ParameterValue& value, bool ours) {
  const auto found_at =
      std::ranges::find(parameters_, value.name, [](const Watched& one) { return one.expected.name; });
  if (found_at == parameters_.end()) return std::nullopt;
  Watched& parameter = *found_at;
  if (parameter.asked) answered_ = std::max(answered_, *parameter.asked);
  parameter.asked.reset();
  parameter.unanswered = silent_heartbeats_ = 0;
  parameter.known = true;
  const bool was_missing = std::exchange(parameter.missing, false);
  if (ours) return std::nullopt;
  const double found = value_of(value, encoding_), expected = parameter.expected.value;
  if (same(found, expected)) {
    if (!parameter.different && !was_missing) return std::nullopt;
    parameter.different.reset();
    return ParameterChanged{value.name, expected, expected};
  }
  if (parameter.different && same(*parameter.different, found)) return std::nullopt;
  parameter.different = found;
  return ParameterChanged{value.name, expected, found};
}

std::optional<AutopilotVersionChanged> ParameterWatch::on_message(const AutopilotVersion& version) {
  if (version.flight_software == 0 || !made_for_global_position_) return std::nullopt;
  const bool wrong_before = wrong_version();
  version_ = version.flight_software;
  if (wrong_version() == wrong_before) return std::nullopt;
  forget_requests();
  return AutopilotVersionChanged{
      .version = fmt::format("{}.{}.{}", *version_ >> 24, (*version_ >> 16) & 0xFF, (*version_ >> 8) & 0xFF),
      .expected = *made_for_global_position_ ? "1.18 or later" : "earlier than 1.18",
      .as_expected = wrong_before};
}

bool ParameterWatch::wrong_version() const {
  return version_ && made_for_global_position_ && (*version_ >= kPx4GlobalPosition) != *made_for_global_position_;
}

ParameterCheck ParameterWatch::check() const {
  if (parameters_.empty()) return ParameterCheck::none_listed;
  const auto deviates = [](const Watched& one) { return one.missing || one.different; };
  if (wrong_version() || std::ranges::any_of(parameters_, deviates)) return ParameterCheck::deviating;
  const bool version_known = version_ || !made_for_global_position_;
  return version_known && std::ranges::all_of(parameters_, &Watched::known) ? ParameterCheck::as_provisioned
                                                                            : ParameterCheck::pending;
}

}  // namespace nadir
