// PX4's logs (.ulg, the ULog format: https://docs.px4.io/main/en/dev_log/ulog_file_format.html), which describe
// themselves.
//
// After a header of 16 bytes come messages: a length of two bytes, a type of one, and the body. Formats ('F') name the
// fields of a topic and may nest; subscriptions ('A') give a topic (and its instance) a number; data ('D') begin with
// that number. Text, parameters and dropouts are counted and skipped. Used here are, of the first instance of each
// topic:
//
//   vehicle_attitude                 q: rotation from the body (forward, right, down) to north, east, down
//   vehicle_gps_position, sensor_gps position, fix_type, time_utc_usec (two generations of field names)
//   vehicle_local_position           z: down from the origin, where the estimator began; dist_bottom: to the ground
//   vehicle_global_position          alt above sea level; terrain_alt, if valid
//   distance_sensor                  current_distance, of the one that looks down
//   camera_capture, camera_trigger   a picture was taken; the camera was triggered
//
// Times are microseconds since boot. Data that were appended after a crash are read where the header says they begin.
#pragma once

#include "flight_import/flight_log.hpp"
#include "flight_import/log_stream.hpp"

namespace nadir {

// Throws UsageError when this is no ULog, or one of a later, incompatible format.
FlightLog read_px4_log(LogStream& stream);

bool is_px4_log(LogStream& stream);  // by its first bytes

}  // namespace nadir
