// Attitude and height of each frame of an import, from the best source that there is, and what was used for how many.
//
//   attitude   the gimbal in the photo; the log, turned by the mount; the photo's own; its image direction alone
//   height     stated; a range finder; the autopilot's terrain; above sea level less the ground's height, stated or
//              from a terrain model; above home or take-off, as if the ground were as high everywhere
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "flight_import/flight_log.hpp"
#include "flight_import/import_report.hpp"
#include "flight_import/imported_flight.hpp"
#include "flight_import/photo_set.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct StatedTelemetry {
  Attitude mount;                  // of the camera in the aircraft
  std::optional<double> agl_m;     // of all frames
  std::optional<double> ground_m;  // height of the ground above sea level
  std::optional<LonLat> takeoff;
  // Of the ground, from an elevation model; empty: there is none.
  std::function<std::optional<double>(LonLat)> ground_height_m;
};

// Between the samples of a log that an attitude is interpolated from.
inline constexpr double kAttitudeGap_s = 2;

class FrameTelemetry {
 public:
  // log: null where there is none. All must outlive this.
  FrameTelemetry(const StatedTelemetry& stated, const FlightLog* log);

  // Fills in attitude and height. log_s: the time of the frame in the log. False: the frame is none of a flight with a
  // camera that looks down, and is to be left out.
  bool measure(const PhotoFacts& photo, std::optional<double> log_s, ImportedFrame& frame);
  // Where the frame was taken, for scoring.
  void set_truth(const PhotoFacts& photo, std::optional<double> log_s, ImportedFrame& frame) const;

  // Of a frame: the camera does not turn with the aircraft.
  bool on_gimbal() const { return used(AttitudeSource::gimbal) > 0; }
  // What was used, assumed and left out, for the frames that are kept.
  void report(const std::vector<ImportedFrame>& frames, const PhotoSet& set, ImportReport& report) const;
  // For a camera file that is drafted: what such sources are good for.
  TelemetryUncertainty uncertainty(const std::vector<ImportedFrame>& frames) const;

 private:
  enum class AttitudeSource { gimbal, log, photo, direction };
  enum class HeightSource { stated, range, autopilot_terrain, stated_ground, terrain_model, home, take_off };
  static constexpr std::size_t kAttitudeSources = 4, kHeightSources = 7;
  static const char* name_of(AttitudeSource source);
  static const char* name_of(HeightSource source);

  std::optional<AttitudeSource> set_attitude(const PhotoFacts& photo, std::optional<double> log_s,
                                             ImportedFrame& frame) const;
  std::optional<HeightSource> set_height(const PhotoFacts& photo, std::optional<double> log_s, ImportedFrame& frame);
  std::optional<double> ground_at(const std::optional<LonLat>& place) const;
  std::size_t used(AttitudeSource source) const { return attitude_used_[static_cast<std::size_t>(source)]; }
  std::size_t used(HeightSource source) const { return height_used_[static_cast<std::size_t>(source)]; }
  void report_left_out(ImportReport& report) const;
  void report_heights(const std::vector<ImportedFrame>& frames, const PhotoSet& set, ImportReport& report) const;
  void report_attitudes(const std::vector<ImportedFrame>& frames, ImportReport& report) const;

  const StatedTelemetry& stated_;
  const FlightLog* log_;
  std::optional<LonLat> home_;
  std::array<std::size_t, kAttitudeSources> attitude_used_{};
  std::array<std::size_t, kHeightSources> height_used_{};
  std::size_t oblique_ = 0, on_ground_ = 0;
  bool absolute_used_ = false;  // a height above sea level
};

}  // namespace nadir
