"""What a ground station receives during a flight, compared with the simulator's truth. Here for ArduPlane: SIM_STATE,
our fix as GPS_RAW_INT."""
import bisect
import collections
import math
import pathlib
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "support"))
from simulated_autopilot.geo import LocalPlane, wrap

from .evidence import WRONG_M, WRONG_SIGMAS

RESET_M = 5.0  # a step of the autopilot's position beyond what its velocity explains
GLITCHING, CONST_POSITION = 1 << 15, 1 << 7  # of EKF_STATUS_REPORT
POSITION_KNOWN = 1 << 4
FIX_3D = 3
CLOCK_WINDOW_S = 2


class Track:
    """A listener of GroundStation. Times are seconds of the autopilot's boot clock, places metres (north, east)."""

    def __init__(self, corners):
        """corners: (lat_deg, lon_deg) of the circuit."""
        self.local = LocalPlane(*corners[0])
        self.corners = [self.local.to_plane(*corner) for corner in corners]
        self._begin()

    def _begin(self):
        self.truth = []  # (time, north, east, altitude, vn, ve)
        self.estimated = []  # (time, north, east, altitude, vn, ve)
        self.given, self.own = [], []  # (time, fix type, north, east, claimed accuracies of place and speed)
        self.attitude = []  # (time, by how many degrees roll, pitch and heading are off)
        self.filter = []  # (time, flags, position variance)
        self.now_s = None
        self._aheads = collections.deque()  # (our time, how far the boot clock is ahead of it), of the last seconds
        self._clock = []  # the same, the largest of the last seconds, since the start
        self._true_attitude = None  # (time, (roll, pitch, yaw), their rates), radians

    def __call__(self, message, now):
        handler = getattr(self, "_" + message.get_type().lower(), None)
        if message.get_srcComponent() == 1 and handler is not None:
            handler(message, now)

    def boot_s(self, now):
        """Boot seconds of one of our times, also of a past one; None before the first."""
        if not self._clock:
            return None
        return now + self._clock[max(0, bisect.bisect(self._clock, (now, math.inf)) - 1)][1]

    def _attitude(self, message, now):
        if self.now_s is not None and message.time_boot_ms / 1000 < self.now_s:
            self._begin()  # it was restarted
        # The smallest delay of the last seconds is nearly zero. Not of all: on a busy machine a simulator's clock falls behind.
        self._aheads.append((now, message.time_boot_ms / 1000 - now))
        while self._aheads[0][0] < now - CLOCK_WINDOW_S:
            self._aheads.popleft()
        self._clock.append((now, max(ahead for _, ahead in self._aheads)))
        self.now_s = message.time_boot_ms / 1000
        if self._true_attitude is not None:
            then_s, angles, rates = self._true_attitude
            measured = (message.roll, message.pitch, message.yaw)
            off = [wrap(a - b - rate * (self.now_s - then_s)) for a, b, rate in zip(measured, angles, rates)]
            self.attitude.append((self.now_s, *map(math.degrees, off)))

    def _sim_state(self, message, now):
        if self._clock:
            self._true_attitude = (self.boot_s(now), (message.roll, message.pitch, message.yaw),
                                   (message.xgyro, message.ygyro, message.zgyro))
            self.truth.append((self.boot_s(now), *self.local.to_plane(message.lat_int * 1e-7, message.lon_int * 1e-7),
                               message.alt, message.vn, message.ve))

    def _global_position_int(self, message, _now):
        self.estimated.append((message.time_boot_ms / 1000, *self.local.to_plane(message.lat * 1e-7, message.lon * 1e-7),
                              message.alt / 1000, message.vx / 100, message.vy / 100))

    def _gps_raw_int(self, message, _now):
        self._receiver(self.given, message)

    def _gps2_raw(self, message, _now):
        self._receiver(self.own, message)

    def _receiver(self, rows, message):
        row = (message.time_usec * 1e-6, message.fix_type, *self.local.to_plane(message.lat * 1e-7, message.lon * 1e-7),
               message.h_acc / 1000, message.vel_acc / 1000)
        if not rows or rows[-1][0] != row[0]:
            rows.append(row)

    def _ekf_status_report(self, message, now):
        self.filter.append((self.boot_s(now), message.flags, message.pos_horiz_variance))

    def truth_at(self, time_s):
        """(north, east, altitude), carried by its velocity from the nearest moment; None further than 0.2 s from any."""
        at = bisect.bisect_left(self.truth, (time_s,))
        near = min(self.truth[max(0, at - 1):at + 1], key=lambda row: abs(row[0] - time_s), default=None)
        if near is None or abs(near[0] - time_s) > 0.2:
            return None
        dt = time_s - near[0]
        return near[1] + near[4] * dt, near[2] + near[5] * dt, near[3]

    def errors(self, rows, from_s, to_s, columns=(1, 2)):
        """[(time, metres)] from the truth."""
        found = []
        for row in rows:
            if from_s <= row[0] <= to_s and (truth := self.truth_at(row[0])) is not None:
                found.append((row[0], math.dist((row[columns[0]], row[columns[1]]), truth[:2])))
        return found

    def fix_errors(self, rows, from_s, to_s):
        return self.errors([row for row in rows if row[1] >= FIX_3D], from_s, to_s, (2, 3))

    def wrong_and_sure(self, from_s, to_s):
        """(number of fixes that are far off without stating so, number of fixes)"""
        accuracies = {row[0]: row[4] for row in self.given}
        errors = self.fix_errors(self.given, from_s, to_s)
        return sum(metres > max(WRONG_M, WRONG_SIGMAS * accuracies[at]) for at, metres in errors), len(errors)

    def deviations(self, from_s, to_s):
        """Distances of the true track from the legs of the circuit, in metres."""
        legs = list(zip(self.corners, self.corners[1:] + self.corners[:1]))
        return [(row[0], min(_to_leg(a, b, row[1:3]) for a, b in legs)) for row in self.truth[::3]
                if from_s <= row[0] <= to_s]

    def resets(self, from_s, to_s):
        """[(time, metres)]: the autopilot's position was reset."""
        found = []
        for a, b in zip(self.estimated, self.estimated[1:]):
            dt = b[0] - a[0]
            step = math.hypot(b[1] - a[1] - (a[4] + b[4]) / 2 * dt, b[2] - a[2] - (a[5] + b[5]) / 2 * dt)
            if from_s <= b[0] <= to_s and dt < 0.5 and step > RESET_M:
                found.append((b[0], step))
        return found

    def attitude_errors(self, from_s, to_s):
        """Of roll, pitch and heading: [mean, spread], degrees; None when nothing was received."""
        columns = list(zip(*(row[1:] for row in self.attitude if from_s <= row[0] <= to_s)))
        return [(statistics.mean(column), statistics.pstdev(column)) for column in columns] or None

    def filter_flags(self, from_s, to_s):
        """(share of the time with an absolute position, share with a glitch, largest position variance)"""
        rows = [row for row in self.filter if row[0] is not None and from_s <= row[0] <= to_s]
        if not rows:
            return None
        return (sum(bool(row[1] & POSITION_KNOWN) and not row[1] & CONST_POSITION for row in rows) / len(rows),
                sum(bool(row[1] & GLITCHING) for row in rows) / len(rows), max(row[2] for row in rows))


def _to_leg(a, b, place):
    along = (b[0] - a[0], b[1] - a[1])
    share = ((place[0] - a[0]) * along[0] + (place[1] - a[1]) * along[1]) / (along[0] ** 2 + along[1] ** 2)
    share = min(1, max(0, share))
    return math.dist(place, (a[0] + share * along[0], a[1] + share * along[1]))
