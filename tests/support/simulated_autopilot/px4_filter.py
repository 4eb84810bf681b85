"""PX4's position filter, with the rules of EKF2 about what it lets in.

From PX4's sources, src/modules/ekf2/EKF: a measurement is rejected when the innovation of an axis is beyond its gate
(estimator updateAidSourceStatus in ekf.h); timeouts are those of common.h (reset_timeout_max 7 s, no_aid_timeout_max
1 s). Sources:

    GNSS                 aid_sources/gnss/gps_control.cpp
    auxiliary position   aid_sources/aux_global_position/aux_global_position_control.cpp: GLOBAL_POSITION_SENSOR
    external vision      aid_sources/external_vision/ev_control.cpp, ev_pos_control.cpp: ODOMETRY

GNSS has other rules since 1.17 (Gnss) than before (OldGnss).

They are fused side by side, each by its own gate. Between them the filter integrates accelerations and is bound by
airspeed and wind, as position_filter.py. Both axes share one covariance.
"""
import math

from .position_filter import ANOTHER, MIN_VELOCITY_NOISE, STILL_ANOTHER, PositionFilter

RESET_TIMEOUT_S, NO_AID_TIMEOUT_S = 7.0, 1.0
# Reasons of resets that a source is meant to cause, beside ANOTHER.
STARTS, GNSS_STOPPED, ANNOUNCED = "starts", "GNSS stopped", "announced"
BY_DESIGN = (ANOTHER, STILL_ANOTHER, STARTS, GNSS_STOPPED, ANNOUNCED)


def timed_out(now_s, last_s, timeout_s):
    return last_s is None or now_s - last_s > timeout_s


class Px4Filter(PositionFilter):
    def __init__(self, north, east, velocity):
        super().__init__(north, east, velocity)
        self.active = set()  # of "gnss", "agp", "ev": control_status.flags
        self.last_position_s = self.last_velocity_s = None

    def other_position_source(self, source):
        return bool(self.active - {source})

    def position_ratio(self, place, sigma, gate):
        """Sum of both axes' squared innovations, in squared gates."""
        return math.dist(place, self.position) ** 2 / (gate ** 2 * (self.pp + sigma ** 2))

    def lets_in(self, place, sigma, gate):
        return max(abs(place[axis] - self.position[axis]) for axis in (0, 1)) <= gate * math.sqrt(self.pp + sigma ** 2)

    def velocity_ratio(self, velocity, sigma, gate):
        return math.dist(velocity[:2], self.velocity) ** 2 / (gate ** 2 * (self.vv + max(MIN_VELOCITY_NOISE, sigma) ** 2))

    def fuse_position(self, now_s, place, sigma, gate, source):
        """True when it was let in."""
        variance = sigma ** 2
        innovation = [place[axis] - self.position[axis] for axis in (0, 1)]
        self.ratio = max(i * i for i in innovation) / (gate ** 2 * (self.pp + variance))
        if self.ratio > 1:
            self.rejected[source] = self.rejected.get(source, 0) + 1
            return False
        self._update_position(innovation, variance)
        self.last_position_s = self.last_fusion_s = now_s
        self.source = source
        self.accepted += 1
        return True

    def fuse_velocity(self, now_s, velocity, sigma, gate):
        variance = max(MIN_VELOCITY_NOISE, sigma) ** 2
        innovation = [velocity[axis] - self.velocity[axis] for axis in (0, 1)]
        if max(i * i for i in innovation) > gate ** 2 * (self.vv + variance):
            return False
        gain_p, gain_v = self.pv / (self.vv + variance), self.vv / (self.vv + variance)
        for axis in (0, 1):
            self.position[axis] += gain_p * innovation[axis]
            self.velocity[axis] += gain_v * innovation[axis]
        self.pp -= gain_p * self.pv
        self.pv -= gain_v * self.pv
        self.vv -= gain_v * self.vv
        self.last_velocity_s = now_s
        return True

    def reset_position(self, now_s, place, sigma, source, reason):
        self.resets.append((now_s, source, reason, math.dist(place, self.position)))
        self.position = list(place)
        self.pp, self.pv, self.ratio = max(0.01, sigma) ** 2, 0.0, 0.0
        self.last_position_s = self.last_fusion_s = now_s
        self.source = source

    def reset_velocity(self, now_s, velocity, sigma):
        self.velocity = list(velocity[:2])
        self.vv, self.pv = max(MIN_VELOCITY_NOISE, sigma) ** 2, 0.0
        self.last_velocity_s = now_s


def glitches(filter_, parameters, sample):
    """ESTIMATOR_GPS_GLITCH: whether the receiver's position is outside its gate, fused or not. Without a fix it is at
    zero degrees. PX4 does not compute it while EKF2_GPS_CTRL is 0: the flag stays what it was."""
    return sample.fix_type < 3 or not filter_.lets_in(
        (sample.north, sample.east), max(sample.h_acc, parameters["EKF2_GPS_P_NOISE"]), parameters["EKF2_GPS_P_GATE"])


class Gnss:
    """The aircraft's own receiver, by the rules since 1.17. Not simulated: the checks on the ground, yaw from velocities.

    Position and velocity start and stop by themselves. Neither is reset while another source aids (EKF2_GPS_MODE 0,
    automatic): a receiver that has been out of its gate for 7 s is stopped as faulty, and one that returns is taken only
    when it agrees."""
    MAX_ACCURACY_M, MAX_SACC = 50.0, 10.0  # in flight: gnss_checks.cpp
    UNDISTURBED_S = 1.0  # a tenth of EKF2_REQ_GPS_H
    POSITION, VELOCITY = 1, 4  # bits of EKF2_GPS_CTRL
    AGREES = 0.25  # sum of both axes' squared innovations, in squared gates

    def __init__(self, filter_, parameters):
        self.filter, self.parameters = filter_, parameters
        self.last_pass_s = self.last_fail_s = None
        self.rejected = False
        self.fault = False
        self.velocity_active = True  # it flies already
        self.last_fused_s = self.last_velocity_s = None
        filter_.active.add("gnss")

    def receive(self, now_s, sample):
        if self.parameters["EKF2_GPS_CTRL"] == 0:
            self.stop()
            return
        self.rejected = glitches(self.filter, self.parameters, sample)
        if self._passes(now_s, sample):
            self._control_velocity(now_s, sample)
            self._control_position(now_s, sample)
        elif timed_out(now_s, self.last_pass_s, RESET_TIMEOUT_S):
            self.stop()

    def stop(self):
        self._stop_position()
        self.velocity_active = False

    def _passes(self, now_s, sample):
        good = sample.fix_type >= 3 and sample.h_acc <= self.MAX_ACCURACY_M and sample.s_acc <= self.MAX_SACC
        if good:
            self.last_pass_s = now_s
        else:
            self.last_fail_s = now_s
        return good and timed_out(now_s, self.last_fail_s, self.UNDISTURBED_S)

    def _control_velocity(self, now_s, sample):
        filter_, gate = self.filter, self.parameters["EKF2_GPS_V_GATE"]
        if not self.parameters["EKF2_GPS_CTRL"] & self.VELOCITY or self.fault:
            self.velocity_active = False
            return
        if self.velocity_active:
            if filter_.fuse_velocity(now_s, sample.velocity, sample.s_acc, gate):
                self.last_velocity_s = now_s
            elif not timed_out(now_s, self.last_velocity_s, RESET_TIMEOUT_S):
                return
            elif self._alone():
                filter_.reset_velocity(now_s, sample.velocity, sample.s_acc)
                self.last_velocity_s = now_s
            else:
                self.velocity_active = False
        elif filter_.velocity_ratio(sample.velocity, sample.s_acc, gate) < self.AGREES:
            self.velocity_active = filter_.fuse_velocity(now_s, sample.velocity, sample.s_acc, gate)
            self.last_velocity_s = now_s
        elif self._alone():
            filter_.reset_velocity(now_s, sample.velocity, sample.s_acc)
            self.velocity_active, self.last_velocity_s = True, now_s

    def _control_position(self, now_s, sample):
        if not self.parameters["EKF2_GPS_CTRL"] & self.POSITION:
            self._stop_position()
            return
        place, gate = (sample.north, sample.east), self.parameters["EKF2_GPS_P_GATE"]
        sigma = max(sample.h_acc, self.parameters["EKF2_GPS_P_NOISE"])
        if "gnss" in self.filter.active:
            if self.filter.fuse_position(now_s, place, sigma, gate, "own"):
                self.last_fused_s = now_s
            elif timed_out(now_s, self.last_fused_s, RESET_TIMEOUT_S):
                if self._alone():
                    self._reset(now_s, place, sigma, "fusion timeout")
                else:
                    self._stop_position()
                    self.fault = True
        elif self.filter.position_ratio(place, sigma, gate) < self.AGREES:
            self.filter.fuse_position(now_s, place, sigma, gate, "own")
            self._start(now_s)
        elif self._alone() and not self.fault:
            self._reset(now_s, place, sigma, ANOTHER)
            self._start(now_s)

    def _alone(self):
        """Airspeed and sideslip bind the velocity, but then the filter says that it is dead reckoning, which counts as none."""
        return not self.filter.other_position_source("gnss")

    def _start(self, now_s):
        self.filter.active.add("gnss")
        self.last_fused_s, self.fault = now_s, False

    def _reset(self, now_s, place, sigma, reason):
        self.filter.reset_position(now_s, place, sigma, "own", reason)
        self.last_fused_s = now_s

    def _stop_position(self):
        self.filter.active.discard("gnss")


class OldGnss:
    """The aircraft's own receiver, by the rules before 1.17. Not simulated: the checks' drift on the ground, yaw from
    velocities."""
    REQUIRED_EPH_M, REQUIRED_SACC = 3.0, 0.5  # EKF2_REQ_EPH, EKF2_REQ_SACC
    UNDISTURBED_S = 1.0  # a tenth of EKF2_REQ_GPS_H
    POSITION, VELOCITY = 1, 4  # bits of EKF2_GPS_CTRL

    def __init__(self, filter_, parameters):
        self.filter, self.parameters = filter_, parameters
        self.last_pass_s = self.last_fail_s = None
        self.rejected = False
        self.last_fused_s = None
        filter_.active.add("gnss")  # it flies already

    def receive(self, now_s, sample):
        control = self.parameters["EKF2_GPS_CTRL"]
        if control == 0:
            self.stop()
            return
        self.rejected = glitches(self.filter, self.parameters, sample)
        good = sample.fix_type >= 3 and sample.h_acc <= self.REQUIRED_EPH_M and sample.s_acc <= self.REQUIRED_SACC
        if good:
            self.last_pass_s = now_s
        else:
            self.last_fail_s = now_s
        if not good or not timed_out(now_s, self.last_fail_s, self.UNDISTURBED_S):
            if timed_out(now_s, self.last_pass_s, RESET_TIMEOUT_S):
                self.stop()
            return
        place = (sample.north, sample.east)
        sigma = max(sample.h_acc, self.parameters["EKF2_GPS_P_NOISE"])
        if "gnss" not in self.filter.active:
            # No gate: a receiver that returns moves the filter to wherever it says.
            if timed_out(now_s, self.filter.last_velocity_s, RESET_TIMEOUT_S) and control & self.VELOCITY:
                self.filter.reset_velocity(now_s, sample.velocity, sample.s_acc)
            if control & self.POSITION:
                self.filter.reset_position(now_s, place, sigma, "own", ANOTHER)
                self.last_fused_s = now_s
            self.filter.active.add("gnss")
            return
        if control & self.VELOCITY:
            self.filter.fuse_velocity(now_s, sample.velocity, sample.s_acc, self.parameters["EKF2_GPS_V_GATE"])
        if control & self.POSITION:
            if self.filter.fuse_position(now_s, place, sigma, self.parameters["EKF2_GPS_P_GATE"], "own"):
                self.last_fused_s = now_s
            elif self._must_reset(now_s):
                self.filter.reset_velocity(now_s, sample.velocity, sample.s_acc)
                self.filter.reset_position(now_s, place, sigma, "own", "fusion timeout")
                self.last_fused_s = now_s

    def stop(self):
        self.filter.active.discard("gnss")

    def _must_reset(self, now_s):
        """shouldResetGpsFusion. The times are those of any source: while ours is let in, GNSS does not reset."""
        position = self.filter.last_position_s
        return ((timed_out(now_s, position, RESET_TIMEOUT_S) and
                 timed_out(now_s, self.filter.last_velocity_s, RESET_TIMEOUT_S)) or
                timed_out(now_s, position, 2 * RESET_TIMEOUT_S))


class AuxiliaryPosition:
    """One slot of the auxiliary global position."""
    SILENCE_S = 5.0
    HORIZONTAL = 1  # bit of EKF2_AGPn_CTRL
    AUTOMATIC = 0  # EKF2_AGPn_MODE
    FIRST_BIT = 4  # of EKF2_SENS_EN

    def __init__(self, filter_, parameters, slot):
        self.filter, self.parameters, self.slot = filter_, parameters, slot
        self.active = False
        self.last_fused_s = self.last_push_s = None

    def parameter(self, name):
        return self.parameters[f"EKF2_AGP{self.slot}_{name}"]

    def receive(self, now_s, place, eph):
        """A word for the log."""
        self.last_push_s = now_s
        enabled = self.parameters.get("EKF2_SENS_EN", -1) >> (self.FIRST_BIT + self.slot) & 1
        if not enabled or not self.parameter("CTRL") & self.HORIZONTAL:
            self._stop()
            return "off"
        sigma = max(eph, self.parameter("NOISE"), 0.01)
        fused = self.filter.fuse_position(now_s, place, sigma, max(1.0, self.parameter("GATE")), "gps_input")
        if fused:
            self.last_fused_s = now_s
        if not self.active:
            if not fused and self._may_reset():
                self._reset(now_s, place, sigma, STARTS)
                fused = True
            if fused:
                self.active = True
                self.filter.active.add("agp")
        elif timed_out(now_s, self.last_fused_s, RESET_TIMEOUT_S):
            if self._may_reset():
                self._reset(now_s, place, sigma, "fusion timeout")
                fused = True
            else:
                self._stop()
        return "accepted" if fused else "innovation"

    def step(self, now_s):
        if self.active and timed_out(now_s, self.last_push_s, self.SILENCE_S):
            self._stop()

    def _may_reset(self):
        # Dead-reckoning mode asks for no source of velocity either; airspeed and sideslip are one on a fixed wing.
        return self.parameter("MODE") == self.AUTOMATIC and not self.filter.other_position_source("agp")

    def _reset(self, now_s, place, sigma, reason):
        self.filter.reset_position(now_s, place, sigma, "gps_input", reason)
        self.last_fused_s = now_s

    def _stop(self):
        self.active = False
        self.filter.active.discard("agp")


class ExternalVision:
    """The position of ODOMETRY in the local NED frame. While GNSS is fused it is relative to an estimated bias."""
    MAX_INTERVAL_S = 0.2  # EV_MAX_INTERVAL
    RESETS = 5  # in the air, per start
    BIAS_NOISE = 0.13  # ev_hgt_bias_nsd
    HORIZONTAL = 1  # bit of EKF2_EV_CTRL

    def __init__(self, filter_, parameters):
        self.filter, self.parameters = filter_, parameters
        self.bias, self.bias_variance, self.with_bias = [0.0, 0.0], 0.0, False
        self.active, self.resets_left = False, 0
        self.last_s = self.last_fused_s = self.reset_counter = None

    def receive(self, now_s, place, variance, reset_counter):
        """A word for the log. place: north, east; variance: of the message."""
        interval = None if self.last_s is None else now_s - self.last_s
        announced = self.reset_counter not in (None, reset_counter)
        self.last_s, self.reset_counter = now_s, reset_counter
        if not self.parameters["EKF2_EV_CTRL"] & self.HORIZONTAL or not all(map(math.isfinite, place)):
            self.stop()
            return "off" if all(map(math.isfinite, place)) else "numbers"
        minimum = self.parameters["EKF2_EVP_NOISE"]
        taken = self.parameters["EKF2_EV_NOISE_MD"] == 0 and all(map(math.isfinite, variance))
        sigma = max(minimum, math.sqrt(max(variance[:2]))) if taken else minimum
        gnss = "gnss" in self.filter.active
        if gnss:
            sigma = max(sigma, self.parameters["EKF2_GPS_P_NOISE"])
        if not self.active:
            if interval is None or interval >= self.MAX_INTERVAL_S:
                return "starting"
            self._set(now_s, place, sigma, gnss, STARTS)
            self.active, self.resets_left = True, self.RESETS
            self.filter.active.add("ev")
            return "accepted"
        if announced or gnss != self.with_bias:
            self._set(now_s, place, sigma, gnss, ANNOUNCED if announced else GNSS_STOPPED)
            return "accepted"
        if self.with_bias:
            self._estimate_bias(place, sigma, interval)
        here = [place[axis] - self.bias[axis] for axis in (0, 1)]
        if self.filter.fuse_position(now_s, here, math.hypot(sigma, math.sqrt(self.bias_variance)),
                                     max(1.0, self.parameters["EKF2_EVP_GATE"]), "gps_input"):
            self.last_fused_s = now_s
            return "accepted"
        if timed_out(now_s, self.last_fused_s, NO_AID_TIMEOUT_S):
            if self.resets_left == 0:
                self.stop()
                return "innovation"
            self.resets_left -= 1
            keeps_gnss = gnss and not timed_out(now_s, self.filter.last_position_s, NO_AID_TIMEOUT_S)
            self._set(now_s, place, sigma, keeps_gnss, "fusion failing")
            return "accepted"
        return "innovation"

    def step(self, now_s):
        if self.active and timed_out(now_s, self.last_s, 2 * self.MAX_INTERVAL_S):
            self.stop()

    def stop(self):
        self.active = False
        self.filter.active.discard("ev")

    def _set(self, now_s, place, sigma, gnss, reason):
        """With GNSS the bias takes up the difference, without it the filter is reset."""
        self.with_bias = gnss
        if gnss:
            self.bias = [place[axis] - self.filter.position[axis] for axis in (0, 1)]
        else:
            self.bias, self.bias_variance = [0.0, 0.0], 0.0
            self.filter.reset_position(now_s, place, sigma, "gps_input", reason)
        self.last_fused_s = now_s

    def _estimate_bias(self, place, sigma, interval):
        """bias_estimator.cpp, without its detection of offsets."""
        self.bias_variance = min(self.bias_variance + self.BIAS_NOISE ** 2 * interval, max(0.01, sigma) ** 2)
        variance = sigma ** 2 + self.filter.pp
        gain = self.bias_variance / (self.bias_variance + variance)
        for axis in (0, 1):
            innovation = place[axis] - self.filter.position[axis] - self.bias[axis]
            if innovation ** 2 <= 9 * (self.bias_variance + variance):
                self.bias[axis] += gain * innovation
        self.bias_variance *= 1 - gain
