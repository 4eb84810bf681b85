"""The whole aircraft: body, receivers, filter, guidance, links. step() is one fiftieth of a second; nothing here looks at
the clock."""
import dataclasses
import math
import random

from .attitude import AttitudeEstimate
from .flight_log import FlightLog
from .geo import LocalPlane
from .guidance import Guidance
from .navigation import Navigation
from .plan import Plan
from .plane import Plane
from .px4_filter import BY_DESIGN
from .px4_navigation import Px4Navigation
from .px4_projection import MapProjection
from .px4_protocol import Px4Protocol
from .px4_telemetry import Px4Telemetry
from .protocol import Protocol
from .scenario import Scenario
from .telemetry import Telemetry
from .terrain import Flat

from pymavlink.dialects.v20 import ardupilotmega as dialect

STEP_S = 0.02
TRUTH_PERIOD_S = 0.04
LOG_PERIOD_S = 0.1
BOOTED_BEFORE_S = 30.0


@dataclasses.dataclass
class Options:
    corners: list  # (lat_deg, lon_deg) of the circuit
    altitude: float  # above the sea
    seed: int = 1
    airspeed: float = 22.0
    wind: tuple = (0.0, 0.0)  # blowing to north, east
    turn_radius: float = 130.0
    terrain: object = dataclasses.field(default_factory=lambda: Flat(0.0))
    unix_us: int = 1_750_000_000_000_000
    events: list = dataclasses.field(default_factory=list)
    gps_input_instance: int = 0
    faults: tuple = ()
    px4_version: tuple = None  # (1, 18): PX4 of this version instead of ArduPilot


class Vehicle:
    def __init__(self, options, link, truth_links=(), log=None):
        """link: to the companion. truth_links: where SIM_STATE goes, unsigned."""
        self.options, self.link, self.truth_links = options, link, truth_links
        self.log = log or FlightLog()
        self.local = LocalPlane(*options.corners[0])
        self.plan = Plan([self.local.to_plane(*corner) for corner in options.corners], options.turn_radius)
        start = self.plan.point(0)
        self.plane = Plane(self._random("plane"), *start, options.altitude, self.plan.direction(0), options.airspeed,
                           options.wind)
        self.guidance = Guidance(self.plan)
        self.scenario = Scenario(options.events)
        if options.px4_version:
            self.protocol, self.telemetry = Px4Protocol(self, link, options.faults), Px4Telemetry(self)
            self.navigation = Px4Navigation(self._random("navigation"), self.plane, self.local, self.protocol.parameters,
                                            options.px4_version)
            if not any(event.action == "gps-denied" and event.time_s == 0 for event in options.events):
                self.navigation.origin = MapProjection(*options.corners[0])  # where it had its first GPS fix
                self.navigation.origin_altitude = options.terrain.height(*options.corners[0])
        else:
            self.protocol, self.telemetry = Protocol(self, link, options.faults), Telemetry(self)
            self.navigation = Navigation(self._random("navigation"), self.plane, self.local, options.gps_input_instance)
        if options.gps_input_instance == 1 and not options.px4_version:
            self.protocol.parameters.update(GPS1_TYPE=1, GPS2_TYPE=14, GPS_PRIMARY=1)
        self.terrain, self.home_altitude = options.terrain, options.terrain.height(*options.corners[0])
        self.filter_name = "EKF2" if options.px4_version else "EKF3"
        self.armed = True
        self.uid = self._random("uid").randbytes(12)
        attitude = self._random("attitude")
        self._attitude = AttitudeEstimate(attitude)
        self._imu_bias = tuple(attitude.gauss(0, 0.03) for _ in range(3))
        self.now_s, self.steps = 0.0, 0
        self.clock_offset_s, self.booted_s = 0.0, -BOOTED_BEFORE_S
        self.camera_cut = False
        self.deviations, self.filter_errors, self.given_errors = [], [], []
        self._resets_told = 0
        self._source = None
        self._nearest = None

    def step(self):
        self.steps += 1
        self.now_s = self.steps * STEP_S
        for event in self.scenario.due(self.now_s):
            self._happen(event)
        for message in self.link.receive():
            self.protocol.handle(message)
        turn = self.guidance.lateral_acceleration(*self.navigation.filter.position, *self.navigation.filter.velocity)
        self.plane.step(STEP_S, turn, self.options.altitude)
        self.navigation.step(self.now_s, STEP_S)
        self._attitude.step(STEP_S, self.plane, self.navigation.filter.velocity)
        self._tell_changes()
        for message in self.telemetry.due(self.now_s):
            self.link.send(message)
        if not self.camera_cut and self._every(TRUTH_PERIOD_S):
            for link in self.truth_links:
                link.send(self.telemetry.system_time())
                link.send(self.telemetry.sim_state())
        if self._every(LOG_PERIOD_S):
            self._write_row()

    def unix_us(self):
        return self.options.unix_us + round((self.now_s + self.clock_offset_s) * 1e6)

    def boot_ms(self):
        return round((self.now_s - self.booted_s) * 1000)

    def estimated_attitude(self):
        return self._attitude.estimate(self.plane)

    def imu_bias(self):
        return self._imu_bias

    def height_above_ground(self):
        return self.plane.altitude - self.terrain.height(*self.local.to_degrees(self.plane.north, self.plane.east))

    def receive_gps_input(self, message):
        lag_s = self.navigation.given.lag_s(self.protocol.parameters)
        word = self.navigation.receive_gps_input(self.now_s, message, lag_s)
        self.note_given(word, message.fix_type >= 3 and word != "gps_id")

    def note_given(self, word, has_place=True):
        """A given position was judged."""
        self.log.verdict(word)
        if has_place and self.navigation.given.sample is not None:
            sample = self.navigation.given.sample
            self.given_errors.append(math.dist((sample.north, sample.east), (self.plane.north, self.plane.east)))

    def summary(self):
        given = self.navigation.given
        return {"duration_s": self.now_s, "seed": self.options.seed, "plan_m": self.plan.length(),
                "deviation_m": figures(self.deviations), "filter_error_m": figures(self.filter_errors),
                "fix_error_m": figures(self.given_errors),
                "gps_input_spacing_max_s": given.longest_s, "gps_input_late": given.late,
                "resets": [dict(zip(("time_s", "source", "reason", "metres"), reset))
                           for reset in self.navigation.filter.resets],
                "resets_by_gps_input": sum(source == "gps_input" and reason not in BY_DESIGN
                                           for _, source, reason, _ in self.navigation.filter.resets),
                "link": {"received": self.link.received, "refused": self.link.refused, "sent": self.link.sent},
                "received": self.protocol.received}

    def _random(self, name):
        return random.Random(f"{self.options.seed}/{name}")

    def _every(self, period):
        return self.steps % round(period / STEP_S) == 0

    def _happen(self, event):
        self.navigation.own.happen(event)
        if event.action in ("link-cut", "link-restore"):
            self.link.cut = event.action == "link-cut"
        elif event.action in ("camera-cut", "camera-restore"):
            self.camera_cut = event.action == "camera-cut"
        elif event.action == "clock-step":
            self.clock_offset_s += event.value
        elif event.action == "compass":
            self._attitude.deviate(math.radians(event.value), event.bearing)
        elif event.action == "reboot":
            self.booted_s = self.now_s
        self.log.event(self.now_s, "scenario", what=str(event))

    def _tell_changes(self):
        resets = self.navigation.filter.resets
        for time_s, source, reason, metres in resets[self._resets_told:]:
            self.log.event(time_s, "reset", source=source, reason=reason, metres=round(metres, 1))
            self._say(dialect.MAV_SEVERITY_WARNING, f"{self.filter_name} position reset to {source} by {metres:.0f} m")
        self._resets_told = len(resets)
        if self.navigation.source != self._source:
            self._source = self.navigation.source
            self.log.event(self.now_s, "source", now=self._source)

    def _say(self, severity, text):
        self.link.send(dialect.MAVLink_statustext_message(severity, text.encode()[:50]))

    def _write_row(self):
        p, nav = self.plane, self.navigation
        deviation, self._nearest = self.plan.deviation(p.north, p.east, self._nearest)
        error = math.dist(nav.filter.position, (p.north, p.east))
        self.deviations.append(deviation)
        self.filter_errors.append(error)
        lat, lon = self.local.to_degrees(p.north, p.east)
        estimated_lat, estimated_lon = self.local.to_degrees(*nav.filter.position)
        sample = nav.given.sample if nav.given.status >= 3 else None
        own = nav.own_sample if nav.own_sample is not None and nav.own_sample.fix_type >= 3 else None
        self.log.row({
            "time_s": self.now_s, "unix_us": self.unix_us(), "lat_deg": lat, "lon_deg": lon, "altitude_m": p.altitude,
            "estimated_lat_deg": estimated_lat, "estimated_lon_deg": estimated_lon, "deviation_m": deviation,
            "filter_error_m": error, "filter_sigma_m": nav.filter.sigma(), "source": nav.source,
            "given_fix_type": nav.given.status,
            "given_error_m": "" if sample is None else math.dist((sample.north, sample.east), (p.north, p.east)),
            "given_accuracy_m": "" if sample is None or sample.h_acc is None else sample.h_acc,
            "given_age_s": "" if nav.given.last_s is None else self.now_s - nav.given.last_s,
            **self._place("given", sample), **self._place("own", own)})

    def _place(self, whose, sample):
        lat, lon = ("", "") if sample is None else self.local.to_degrees(sample.north, sample.east)
        return {f"{whose}_lat_deg": lat, f"{whose}_lon_deg": lon}


def figures(values):
    """Median, 95th percentile and maximum; None without values."""
    if not values:
        return None
    ordered = sorted(values)
    return {"median": round(ordered[len(ordered) // 2], 2), "p95": round(ordered[int(len(ordered) * 0.95)], 2),
            "max": round(ordered[-1], 2), "count": len(ordered)}
