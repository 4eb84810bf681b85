// ArduPilot's dataflash logs (.BIN), which describe themselves.
//
// A record is A3 95, a type of one byte, and a body whose length its format states. Formats are records themselves
// (type 128, FMT): type, length of the whole record, a name of 4 characters, 16 characters of which each is the type of
// a field, and the fields' names separated by commas. So nothing here depends on ArduPilot's version but names:
//
//   ATT   Roll, Pitch, Yaw              attitude (degrees)
//   GPS   Status, GWk, GMS, Lat, Lng, Alt   position and the date (Status 3 and above is a 3D fix)
//   POS   Alt, RelHomeAlt               fused height above sea level and above home
//   BARO  Alt                           above the place of arming; where POS is missing
//   RFND  Dist, Orient, Stat            range finder; Orient 25 looks down, Stat 4 is good
//   TERR  CHeight, Status               height above the autopilot's terrain
//   CAM   a picture was taken; TRIG     the camera was triggered (where CAM is missing)
//
// Time is TimeUS, microseconds since boot; old logs have TimeMS. Damaged records are skipped to the next A3 95 of a
// known type; what was skipped is counted.
#pragma once

#include "flight_import/flight_log.hpp"
#include "flight_import/log_stream.hpp"

namespace nadir {

// Throws UsageError when this is no dataflash log.
FlightLog read_ardupilot_log(LogStream& stream);

bool is_ardupilot_log(LogStream& stream);  // by its first bytes

}  // namespace nadir
