"""The autopilot's position filter, with the rules of ArduPilot's EKF3 about what it lets in.

From NavEKF3_PosVelFusion.cpp: a position passes while the innovation is within five standard deviations of filter and
receiver together (EK3_POS_I_GATE, EK3_VEL_I_GATE); when none has passed for ten seconds, or the filter is less sure than
EK3_GLITCH_RAD, it is *reset* to the receiver. So it is to another receiver that takes over, at once and without a gate;
where that one states more than the radius allows, the next fixes reset it as well, until it is surer.
Between fixes it integrates accelerations; without any it holds the airspeed and the last known wind, as EKF3 does with an
airspeed sensor. Both axes share one covariance.
"""
import math

GATE = 5.0
RETRY_S = 10.0
GLITCH_RADIUS_M = 25.0
MIN_POSITION_NOISE_M = 0.5
MIN_VELOCITY_NOISE = 0.3
ACCELERATION_NOISE = 0.35
WIND_NOISE = 1.5  # of the remembered wind
ANOTHER = "another receiver"  # a reason for a reset
STILL_ANOTHER = "another receiver, still unsure"


class PositionFilter:
    def __init__(self, north, east, velocity):
        self.position = [north, east]
        self.velocity = list(velocity[:2])
        self.wind = [0.0, 0.0]
        self.pp, self.pv, self.vv = 4.0, 0.0, 1.0  # covariance of position and velocity, each axis
        self.last_pass_s = None
        self.last_fusion_s = None
        self.source = None  # of the last sample that was let in
        self._taking_over = False  # that source has done nothing but reset the filter yet
        self.ratio = 0.0  # of the last position innovation to its gate, squared
        self.accepted = 0
        self.rejected = {}
        self.resets = []  # (time, source, reason, metres)

    def predict(self, dt, acceleration):
        for axis in (0, 1):
            self.position[axis] += self.velocity[axis] * dt + acceleration[axis] * dt * dt / 2
            self.velocity[axis] += acceleration[axis] * dt
        noise = ACCELERATION_NOISE ** 2 * dt
        self.pp += 2 * dt * self.pv + dt * dt * self.vv
        self.pv += dt * self.vv
        self.vv += noise

    def hold_airspeed(self, now_s, air_velocity):
        """The velocity through the air, a few times a second: binds the velocity while no receiver does, and else
        learns the wind."""
        if self.last_fusion_s is not None and now_s - self.last_fusion_s < 1.0:
            for axis in (0, 1):
                self.wind[axis] += 0.02 * (self.velocity[axis] - air_velocity[axis] - self.wind[axis])
            return
        # What the wind may be wrong by stays wrong: it binds the velocity, and the position's uncertainty grows with it.
        for axis in (0, 1):
            self.velocity[axis] += 0.2 * (air_velocity[axis] + self.wind[axis] - self.velocity[axis])
        self.vv = min(self.vv, WIND_NOISE ** 2)
        self.pv = min(self.pv, math.sqrt(self.pp * self.vv))

    def fuse(self, now_s, sample, source):
        """True when the sample was let in. source: a name for the log."""
        r = max(MIN_POSITION_NOISE_M, min(100.0, sample.h_acc if sample.h_acc is not None else 1.0)) ** 2
        innovation = (sample.north - self.position[0], sample.east - self.position[1])
        self.ratio = (innovation[0] ** 2 + innovation[1] ** 2) / (GATE ** 2 * 2 * (self.pp + r))
        if self.last_pass_s is None:
            self.last_pass_s = now_s
        passed = self.ratio < 1
        timed_out = now_s - self.last_pass_s > RETRY_S
        unsure = 2 * self.pp > GLITCH_RADIUS_M ** 2
        changed = self.source not in (None, source)
        if not passed and not timed_out and not changed:
            self.rejected[source] = self.rejected.get(source, 0) + 1
            return False
        self.last_pass_s = self.last_fusion_s = now_s
        self.source = source
        self.accepted += 1
        if timed_out or unsure or changed:
            if changed:
                reason = ANOTHER
            elif unsure and self._taking_over:
                reason = STILL_ANOTHER
            else:
                reason = "out of the gate" if not passed else "ten seconds without" if timed_out else "too unsure"
            self._taking_over = reason in (ANOTHER, STILL_ANOTHER)
            self._reset(now_s, sample, source, reason, math.hypot(*innovation), r)
            return True
        self._taking_over = False
        self._update_position(innovation, r)
        if sample.velocity is not None:
            self._update_velocity(sample)
        return True

    def sigma(self):
        return math.sqrt(self.pp)

    def _reset(self, now_s, sample, source, reason, metres, r):
        self.resets.append((now_s, source, reason, metres))
        self.position = [sample.north, sample.east]
        if sample.velocity is not None:
            self.velocity = list(sample.velocity[:2])
        self.pp, self.pv, self.vv = r, 0.0, max(MIN_VELOCITY_NOISE, sample.s_acc or 1.0) ** 2
        self.ratio = 0.0

    def _update_position(self, innovation, r):
        s = self.pp + r
        gain_p, gain_v = self.pp / s, self.pv / s
        for axis in (0, 1):
            self.position[axis] += gain_p * innovation[axis]
            self.velocity[axis] += gain_v * innovation[axis]
        self.vv -= gain_v * self.pv
        self.pv -= gain_p * self.pv
        self.pp -= gain_p * self.pp

    def _update_velocity(self, sample):
        r = max(MIN_VELOCITY_NOISE, sample.s_acc if sample.s_acc is not None else 1.0) ** 2
        s = self.vv + r
        innovation = [sample.velocity[axis] - self.velocity[axis] for axis in (0, 1)]
        if innovation[0] ** 2 + innovation[1] ** 2 > GATE ** 2 * 2 * s:
            return
        gain_p, gain_v = self.pv / s, self.vv / s
        for axis in (0, 1):
            self.position[axis] += gain_p * innovation[axis]
            self.velocity[axis] += gain_v * innovation[axis]
        self.pp -= gain_p * self.pv
        self.pv -= gain_v * self.pv
        self.vv -= gain_v * self.vv
