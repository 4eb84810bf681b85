// What every autopilot log becomes when it is read: what was measured, and when. The readers of ArduPilot, PX4 and
// MAVLink logs fill this form; the import asks it for values at the times of photos.
//
// Three clocks meet in an import:
//
//   log time      seconds since the autopilot's boot. Every sample here has it, in increasing order.
//   UTC           unix time = log time + unix_from_log_s, when the log's GPS (or ground station) knew the date.
//   camera time   what photos say: the wall clock of the camera. log time = camera time + clock offset, and the offset
//                 is what clock_offset.hpp estimates.
//
// Heights: nothing in a log is reliably the height above ground that localization needs. In the order of preference:
// a range finder, the autopilot's own terrain, the height above home (true above flat ground only), the height above
// mean sea level (needs a terrain model, or the height of the ground). They are kept apart, so that the import can say
// which it used.
//
// A GPS position is ground truth for scoring, never an input of localization.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "estimation/inertial_preintegration.hpp"
#include "geodesy/lon_lat.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct TimedAttitude {
  double time_s = 0;
  Attitude aircraft;  // yaw from true north, pitch nose up, roll right wing down
};

struct TimedHeight {
  double time_s = 0;
  double height_m = 0;
};

struct TimedPosition {
  double time_s = 0;
  LonLat place;
  double msl_m = 0;
};

// The camera was triggered, or reported a picture.
struct CameraTrigger {
  double time_s = 0;
};

struct FlightLog {
  std::string format;  // "ArduPilot dataflash log"
  std::optional<double> unix_from_log_s;
  std::string utc_from;  // what knew the date: "GPS", "ground station"
  std::vector<TimedAttitude> attitudes;
  std::vector<TimedHeight> ranges;           // distance to the ground below, as measured
  std::vector<TimedHeight> terrain_heights;  // above the autopilot's terrain
  std::vector<TimedHeight> home_heights;     // above home or the place of take-off
  std::vector<TimedHeight> msl_heights;      // above mean sea level
  std::vector<TimedPosition> positions;      // of the GPS receiver, with a 3D fix
  std::vector<CameraTrigger> triggers;
  std::vector<InertialSample> inertial;  // axes: forward, right, down; of the first sensor, at most kInertialRate_hz

  std::uint64_t records = 0;        // that were read
  std::uint64_t damaged = 0;        // records that were not
  std::uint64_t skipped_bytes = 0;  // between records
  std::uint64_t wrong_times = 0;    // samples whose time jumps away from their neighbours'
  bool truncated = false;           // the log ends inside a record
  bool restarted = false;           // its clock starts again: what follows belongs to another flight and is not read
  std::size_t vehicles = 1;         // autopilots that speak in it; the first one's data are here

  bool empty() const { return attitudes.empty() && ranges.empty() && home_heights.empty() && msl_heights.empty(); }
  double begin_s() const;  // of all samples
  double end_s() const;
};

// A replay needs no more; autopilots log up to some thousand a second.
inline constexpr double kInertialRate_hz = 125;

// Linear between the samples around the time; nothing where these are further apart than the gap, or before the first
// and after the last one by more than it.
std::optional<double> height_at(const std::vector<TimedHeight>& heights, double time_s, double max_gap_s);
std::optional<Attitude> attitude_at(const std::vector<TimedAttitude>& attitudes, double time_s, double max_gap_s);
std::optional<TimedPosition> position_at(const std::vector<TimedPosition>& positions, double time_s, double max_gap_s);

// Puts samples into the form as they come from a reader. A log may hold samples slightly out of order (dropped), times
// that are damaged (dropped and counted) and, after a restart of the autopilot, a clock that begins anew (reading
// ends).
class LogBuilder {
 public:
  explicit LogBuilder(std::string format) { log_.format = std::move(format); }

  // Whether samples of this time are taken.
  bool take_time(double time_s);
  bool restarted() const { return log_.restarted; }

  // Values that are not finite or not possible are dropped. Angles in radians.
  void attitude(double time_s, double heading_rad, double pitch_rad, double roll_rad);
  void height(std::vector<TimedHeight> FlightLog::*which, double time_s, double height_m);
  void position(double time_s, LonLat place, double msl_m);
  // Averaged to kInertialRate_hz.
  void inertial(double time_s, const Eigen::Vector3d& rate_rad_s, const Eigen::Vector3d& force_mps2);
  void trigger(double time_s);             // reported by the camera, or by its hot shoe
  void commanded_trigger(double time_s);   // counts in a log that has none of the exact ones
  void utc(double time_s, double unix_s);  // both of one moment

  FlightLog& log() { return log_; }
  FlightLog finish();

 private:
  FlightLog log_;
  std::vector<CameraTrigger> commanded_;
  InertialSample sum_;  // of the samples since the last that was taken
  int summed_ = 0;
  std::optional<double> last_s_;
  double rejected_s_ = 0;  // the last time that was not taken
  int rejected_ = 0;       // in a row, and in agreement with each other
  std::vector<double> unix_from_log_s_;
};

}  // namespace nadir
