"""Which receiver the autopilot flies by, and its filter.

GPS_AUTO_SWITCH 4, "use primary if it has a 3-D fix or better": the receiver that GPS_INPUT plays is the primary, the
aircraft's own one takes over while the primary has no fix. EK3_GPS_CHECK keeps a receiver out that is not good enough
to begin with when the filter has had none for a while.
"""
import copy

from .accuracy_alarm import AccuracyAlarm
from .gps_input import GpsInputReceiver, alignment_refusals
from .position_filter import PositionFilter
from .receiver import Receiver
from .gauss_markov import GaussMarkov

UNAIDED_S = 30.0


class Navigation:
    def __init__(self, random, plane, local, gps_input_instance):
        """plane: the aircraft. local: LocalPlane."""
        self.aircraft = plane
        self.own = Receiver(random)
        self.given = GpsInputReceiver(gps_input_instance, local)
        self.filter = PositionFilter(plane.north, plane.east, plane.velocity)
        self.accelerometer = [GaussMarkov(random, 0.06, 120) for _ in range(2)]
        self.height_error = GaussMarkov(random, 1.0, 120)
        self.accuracy_alarm = AccuracyAlarm()
        self.own_sample = None
        self.source = "none"
        self.given_fused = 0
        self._next_own_s = 0.0
        self._next_air_s = 0.0

    def step(self, now_s, dt):
        acceleration = [true + error.step(dt) for true, error in zip(self.aircraft.acceleration, self.accelerometer)]
        self.height_error.step(dt)
        self.filter.predict(dt, acceleration)
        if now_s >= self._next_air_s:
            self._next_air_s = now_s + 0.2
            wind = [w + g.value for w, g in zip(self.aircraft.wind, self.aircraft.gusts)]
            self.filter.hold_airspeed(now_s, [v - w for v, w in zip(self.aircraft.velocity, wind)])
        self.given.gone(now_s)
        if now_s >= self._next_own_s:
            self._next_own_s = now_s + Receiver.PERIOD
            self.own_sample = self.own.sample(self.aircraft)
            if self.own_sample.fix_type >= 3 and not self.given_leads(now_s):
                self._fuse(now_s, self.own_sample, "own")
        if self.source != "none" and now_s - (self.filter.last_fusion_s or 0) > 1.0:
            self.source = "none"

    def receive_gps_input(self, now_s, message, lag_s=0.0):
        """A word for the log: "accepted", or why not. lag_s: how old the autopilot takes the position to be."""
        before = dict(self.given.refused)
        sample = self.given.receive(message, now_s)
        if sample is None:
            return next(reason for reason, n in self.given.refused.items() if n != before.get(reason, 0))
        last = self.filter.last_fusion_s
        if last is not None and now_s - last > UNAIDED_S and alignment_refusals(sample):
            return self._count("alignment")
        if not self._fuse(now_s, self._propagated(sample, lag_s), "gps_input"):
            return "innovation"
        self.given_fused += 1
        return "accepted"

    def given_leads(self, now_s):
        return self.given.status >= 3 and self.given.healthy(now_s)

    def altitude(self):
        return self.aircraft.altitude + self.height_error.value

    def _propagated(self, sample, lag_s):
        """Where the receiver must be now if it was there so long ago."""
        propagated = copy.copy(sample)
        propagated.north += self.filter.velocity[0] * lag_s
        propagated.east += self.filter.velocity[1] * lag_s
        return propagated

    def _count(self, reason):
        self.given.refused[reason] = self.given.refused.get(reason, 0) + 1
        return reason

    def _fuse(self, now_s, sample, source):
        self.accuracy_alarm.update(now_s, sample.s_acc)
        if not self.filter.fuse(now_s, sample, source):
            return False
        self.source = source
        return True
