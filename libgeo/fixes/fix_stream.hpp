// The fixes that the autopilot gets, as a function of what enters:
//
//   attitude, acceleration   of the autopilot, at their times of arrival
//   estimate                 of the localizer, at its time of arrival
//   turn                     a time, the same moment in UTC, and what the service says about the position (FixStatus)
//
// and of their order. A turn may come at any time; a fix follows from it when one is due (fix_predictor.hpp). Nothing
// else has a part in it: no clock, no thread, no wire. Whatever enters is listed until the next fix is due and then
// handed out as a FixInputRecord, so that in flight the recorder gets exactly what the fix was made of; the same class
// makes the same fix from the record, bit for bit (replay/replayed_fixes.hpp). Attitude and acceleration enter in
// single precision: as the autopilot sends them, and as they are recorded.
//
// Times are those of a steady clock, in microseconds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "estimation/estimate.hpp"
#include "estimation/localizer.hpp"
#include "fixes/fix_predictor.hpp"
#include "mavlink/gps_input.hpp"
#include "recorder/records.hpp"

namespace nadir {

// A fix that is due.
struct DueFix {
  FixInputRecord inputs;  // `sent` is left to the caller
  GpsInput message;       // what is to be sent, if fixes are served
  SourceLabel source = SourceLabel::no_fix;
  std::optional<Fix> fix;            // in the message; nullopt: "no fix"
  std::optional<double> jumped_m{};  // so far from the last fix, and both are sent: tell the operator
};

class FixStream {
 public:
  // In one record; further ones count as missing. Ten times as many as an autopilot sends in a second.
  static constexpr std::size_t kMaxInputs = 1000;

  explicit FixStream(std::uint8_t gps_id = 0) : gps_id_(gps_id) {}

  void on_input(std::int64_t now_us, const FixInputRecord::Attitude& attitude);
  void on_input(std::int64_t now_us, const FixInputRecord::Acceleration& acceleration);
  // which: of the localizer's estimates this one is. False: ignored (FixPredictor::on_estimate).
  bool on_input(std::int64_t now_us, const FixInputRecord::ArrivedEstimate& which, const VisionEstimate& estimate);

  std::optional<DueFix> turn(std::int64_t now_us, std::int64_t unix_us, const FixStatus& status);

  std::int64_t next_due_us() const { return predictor_.next_due_us(); }  // 0 before the first

 private:
  template <typename What>
  void list(std::int64_t now_us, const What& what);

  std::uint8_t gps_id_;
  FixPredictor predictor_;
  FixInputRecord entered_;  // since the last fix was due
};

// An estimate of a frame that was captured at that time; ground_msl_m: of the ground beneath it, where it is known.
// Nothing without a position, or when the time is none. Its σ bounds the protection level at the risk as well
// (estimation/protection_level.hpp): docs/autopilot.md says why.
std::optional<VisionEstimate> vision_estimate(const Estimate& estimate, const StateEstimate& state, double captured_s,
                                              std::optional<double> ground_msl_m, double integrity_risk);

// A fix that was sent, without the aircraft's real receiver.
FixRecord fix_record(const DueFix& sent);

}  // namespace nadir
