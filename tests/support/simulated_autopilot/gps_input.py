"""The receiver that GPS_INPUT plays, as ArduPilot's AP_GPS and AP_GPS_MAV treat it.

From the sources of ArduPilot (libraries/AP_GPS/AP_GPS.cpp, AP_GPS_MAV.cpp): a message for another instance is ignored;
the fix type is taken as it is; a receiver is healthy while its messages come less than 215 ms apart on average and no two
in a row come more than 245 ms after the one before; after four seconds of silence it is gone. A position counts as
GPSn_DELAY_MS old, and as 200 ms old when that is 0 (GPS_Backend.h).
"""
import math

from .receiver import GpsSample

MAX_SPACING_S, MAX_AVERAGE_S = 0.245, 0.215
MAX_DELAYED = 2
TIMEOUT_S = 4.0
USUAL_LAG_S = 0.2

IGNORE_ALT, IGNORE_HDOP, IGNORE_VDOP, IGNORE_VEL_HORIZ, IGNORE_VEL_VERT = 1, 2, 4, 8, 16
IGNORE_SPEED_ACCURACY, IGNORE_HORIZONTAL_ACCURACY, IGNORE_VERTICAL_ACCURACY = 32, 64, 128


def alignment_refusals(sample):
    """Why the filter would not begin to use this receiver, nor the aircraft be armed (EK3_GPS_CHECK)."""
    refusals = []
    if sample.fix_type < 3:
        refusals.append("fix")
    if sample.h_acc is not None and sample.h_acc > 5:
        refusals.append("h_acc")
    if sample.v_acc is not None and sample.v_acc > 7.5:
        refusals.append("v_acc")
    if sample.s_acc is not None and sample.s_acc > 1:
        refusals.append("s_acc")
    if sample.hdop > 2.5:
        refusals.append("hdop")
    if sample.satellites < 6:
        refusals.append("satellites")
    return refusals


class GpsInputReceiver:
    def __init__(self, instance, plane):
        """instance: 0 or 1. plane: LocalPlane."""
        self.instance, self.plane = instance, plane
        self.last_s = None
        self.average_s = None
        self.delayed_in_a_row = 0
        self.longest_s = 0.0
        self.count = 0
        self.late = 0
        self.refused = {}
        self.status = 0
        self.sample = None

    def receive(self, message, now_s):
        """The GpsSample of a message that is used, or None; `refused` counts the reasons."""
        if message.gps_id != self.instance:
            return self._refuse("gps_id")
        self._time(now_s)
        self.count += 1
        self.status = message.fix_type
        flags = message.ignore_flags
        numbers = [message.alt, message.hdop, message.vn, message.ve, message.vd, message.speed_accuracy,
                   message.horiz_accuracy, message.vert_accuracy]
        if not all(math.isfinite(number) for number in numbers) or not abs(message.lat) <= 900000000:
            self.status = 0
            return self._refuse("numbers")
        north, east = self.plane.to_plane(message.lat * 1e-7, message.lon * 1e-7)
        velocity = None
        if not flags & IGNORE_VEL_HORIZ:
            velocity = (message.vn, message.ve, 0.0 if flags & IGNORE_VEL_VERT else message.vd)
        self.sample = GpsSample(
            message.fix_type, north, east, None if flags & IGNORE_ALT else message.alt, velocity,
            None if flags & IGNORE_HORIZONTAL_ACCURACY else message.horiz_accuracy,
            None if flags & IGNORE_VERTICAL_ACCURACY else message.vert_accuracy,
            None if flags & IGNORE_SPEED_ACCURACY else message.speed_accuracy,
            99.99 if flags & IGNORE_HDOP else message.hdop, message.satellites_visible)
        if message.fix_type < 3:
            return self._refuse("no_fix")
        if not self.healthy(now_s):
            return self._refuse("unhealthy")
        return self.sample

    def lag_s(self, parameters):
        """How old its positions are, to the autopilot's mind."""
        return parameters[f"GPS{self.instance + 1}_DELAY_MS"] / 1000 or USUAL_LAG_S

    def healthy(self, now_s):
        return (self.last_s is not None and now_s - self.last_s < TIMEOUT_S and self.delayed_in_a_row < MAX_DELAYED and
                (self.average_s or 0) < MAX_AVERAGE_S)

    def gone(self, now_s):
        """True once when it has been silent for too long."""
        if self.last_s is None or now_s - self.last_s < TIMEOUT_S:
            return False
        self.last_s, self.average_s, self.status, self.sample = None, None, 0, None
        self.delayed_in_a_row = 0
        return True

    def _time(self, now_s):
        if self.last_s is not None:
            spacing = now_s - self.last_s
            self.longest_s = max(self.longest_s, spacing)
            if spacing > MAX_SPACING_S:
                self.delayed_in_a_row += 1
                self.late += 1
            else:
                self.delayed_in_a_row = 0
            if spacing < 2:
                self.average_s = spacing if self.average_s is None else 0.98 * self.average_s + 0.02 * spacing
        self.last_s = now_s

    def _refuse(self, reason):
        self.refused[reason] = self.refused.get(reason, 0) + 1
        return None
