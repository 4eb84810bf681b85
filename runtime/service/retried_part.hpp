// A part that the flight can do without: state directory, API, recorder, candidate tiles. Its failure never ends the
// service. Its failure is reported once, it is tried again after one second, two, four, at most every half
// minute, and its recovery is reported.
//
//   RetriedPart api("API");
//   if (!server) report(api.attempt(now_s, [&] { server = listen(); }));
//
// For one thread.
#pragma once

#include <algorithm>
#include <exception>
#include <optional>
#include <string>
#include <utility>

#include "service/onboard_event.hpp"
#include "service/service_rules.hpp"

namespace nadir {

class RetriedPart {
 public:
  explicit RetriedPart(std::string name) : name_(std::move(name)) {}

  bool works() const { return !failed_since_s_; }
  bool due(double now_s) const { return works() || now_s >= next_s_; }

  // Does the work when it is due: always while the part works, else after the pause. What changed, if anything: an
  // exception is a failure.
  template <typename Work>
  std::optional<PartReported> attempt(double now_s, const Work& work) {
    if (!due(now_s)) return std::nullopt;
    std::string failure;
    try {
      work();
    } catch (const std::exception& error) {
      failure = error.what();
      if (failure.empty()) failure = "no reason given";
    }
    return note(now_s, failure);
  }

  // The same for work that was done elsewhere. failure: empty when it went well.
  std::optional<PartReported> note(double now_s, const std::string& failure) {
    if (failure.empty()) {
      if (works()) return std::nullopt;
      const double off_s = now_s - *std::exchange(failed_since_s_, std::nullopt);
      pause_s_ = kFirstRetry_s;
      return PartReported{name_, {}, off_s};
    }
    next_s_ = now_s + pause_s_;
    pause_s_ = std::min(2 * pause_s_, kLastRetry_s);
    if (!works()) return std::nullopt;
    failed_since_s_ = now_s;
    return PartReported{name_, failure, 0};
  }

 private:
  std::string name_;
  std::optional<double> failed_since_s_;
  double next_s_ = 0, pause_s_ = kFirstRetry_s;
};

}  // namespace nadir
