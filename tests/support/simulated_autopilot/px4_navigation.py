"""PX4's sources and its filter: the same interface as navigation.py."""
import math

from .gauss_markov import GaussMarkov
from .px4_filter import AuxiliaryPosition, ExternalVision, Gnss, OldGnss, Px4Filter
from .px4_projection import MapProjection
from .receiver import GpsSample, Receiver

FRESH_S = 1.0
SLOTS = 4
GNSS_AGREES_FROM = (1, 17)  # ours keeps a GNSS out that disagrees


class Given:
    """The positions that are given, whatever the message: what the log and the figures need."""
    LATE_S = 0.245

    def __init__(self):
        self.instance = None  # of no GPS receiver
        self.sample, self.last_s, self.longest_s, self.late, self.refused = None, None, 0.0, 0, {}
        self.now_s = 0.0

    @property
    def status(self):
        return 3 if self.last_s is not None and self.now_s - self.last_s < FRESH_S else 0

    def note(self, now_s, north, east, sigma):
        if self.last_s is not None:
            self.longest_s = max(self.longest_s, now_s - self.last_s)
            self.late += now_s - self.last_s > self.LATE_S
        self.last_s = self.now_s = now_s
        self.sample = GpsSample(3, north, east, h_acc=sigma)


class Px4Navigation:
    def __init__(self, random, plane, local, parameters, version):
        self.aircraft, self.local = plane, local
        self.own, self.given = Receiver(random), Given()
        self.filter = Px4Filter(plane.north, plane.east, plane.velocity)
        self.gnss = (Gnss if version >= GNSS_AGREES_FROM else OldGnss)(self.filter, parameters)
        self.agp = [AuxiliaryPosition(self.filter, parameters, slot) for slot in range(SLOTS)]
        self.ev = ExternalVision(self.filter, parameters)
        self.parameters = parameters
        self.origin = None  # MapProjection, and its height: of the local frame
        self.origin_altitude = 0.0
        self.accelerometer = [GaussMarkov(random, 0.06, 120) for _ in range(2)]
        self.height_error = GaussMarkov(random, 1.0, 120)
        self.own_sample = None
        self.source = "none"
        self._given_fused_s = None
        self._next_own_s = self._next_air_s = 0.0

    def step(self, now_s, dt):
        acceleration = [true + error.step(dt) for true, error in zip(self.aircraft.acceleration, self.accelerometer)]
        self.height_error.step(dt)
        self.filter.predict(dt, acceleration)
        if now_s >= self._next_air_s:
            self._next_air_s = now_s + 0.2
            wind = [w + g.value for w, g in zip(self.aircraft.wind, self.aircraft.gusts)]
            self.filter.hold_airspeed(now_s, [v - w for v, w in zip(self.aircraft.velocity, wind)])
        self.given.now_s = now_s
        for source in (*self.agp, self.ev):
            source.step(now_s)
        if now_s >= self._next_own_s:
            self._next_own_s = now_s + Receiver.PERIOD
            self.own_sample = self.own.sample(self.aircraft)
            self.gnss.receive(now_s, self.own_sample)
            if self.own_sample.fix_type >= 3:
                self._begin_at(self.local.to_degrees(self.own_sample.north, self.own_sample.east))
        self.source = self._leads(now_s)

    def receive_global_position(self, now_s, message):
        """GLOBAL_POSITION_SENSOR: a word for the log."""
        slot = next((agp for agp in self.agp if agp.parameter("ID") == message.id and message.id != 0), None)
        place = self.local.to_plane(message.lat * 1e-7, message.lon * 1e-7)
        self.given.note(now_s, *place, message.eph)
        if slot is None:
            return "id"
        if not math.isfinite(message.eph):
            return "numbers"
        self._begin_at((message.lat * 1e-7, message.lon * 1e-7))
        return self._noted(now_s, slot.receive(now_s, place, message.eph))

    def receive_odometry(self, now_s, message):
        """ODOMETRY in MAV_FRAME_LOCAL_NED: a word for the log."""
        if self.origin is None:
            return "no origin"
        if not all(math.isfinite(n) for n in (message.x, message.y, message.z)):
            return "numbers"
        place = self.local.to_plane(*self.origin.reproject(message.x, message.y))
        variance = [message.pose_covariance[i] for i in (0, 6, 11)]
        self.given.note(now_s, *place, math.sqrt(variance[0]))
        return self._noted(now_s, self.ev.receive(now_s, place, variance, message.reset_counter))

    def _begin_at(self, place):
        """The first position of a source in degrees is the origin; the barometer says its height."""
        if self.origin is None:
            self.origin, self.origin_altitude = MapProjection(*place), self.altitude()

    def altitude(self):
        return self.aircraft.altitude + self.height_error.value

    def _noted(self, now_s, word):
        if word == "accepted":
            self._given_fused_s = now_s
        return word

    def _leads(self, now_s):
        """GNSS while it is let in; with both the position is nearly its."""
        if self.gnss.last_fused_s is not None and now_s - self.gnss.last_fused_s < FRESH_S:
            return "own"
        if self._given_fused_s is not None and now_s - self._given_fused_s < FRESH_S:
            return "gps_input"
        return "none"
