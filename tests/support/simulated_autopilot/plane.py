"""A fixed wing as a moving point: constant airspeed, banked turns, wind with gusts, a body that never sits quite still."""
import math

from .geo import wrap
from .gauss_markov import GaussMarkov

GRAVITY = 9.80665
MAX_BANK = math.radians(38)
MAX_ROLL_RATE = math.radians(40)
MAX_CLIMB = 3.0
ANGLE_OF_ATTACK = math.radians(1.5)


class Plane:
    def __init__(self, random, north, east, altitude, heading, airspeed=22.0, wind=(0.0, 0.0)):
        self.north, self.east, self.altitude = north, east, altitude
        self.heading, self.bank, self.climb = heading, 0.0, 0.0
        self.airspeed, self.wind = airspeed, wind
        self.gusts = (GaussMarkov(random, 0.7, 8), GaussMarkov(random, 0.7, 8))
        self.shake = [GaussMarkov(random, math.radians(degrees), 0.8) for degrees in (0.6, 0.4, 0.3)]
        self.velocity = self._velocity()
        self.acceleration = (0.0, 0.0, 0.0)  # north, east, down
        self.roll, self.pitch, self.yaw = self._attitude()
        self.rates = (0.0, 0.0, 0.0)  # of the body about its axes: forward, right, down
        self._inertial = []

    def step(self, dt, lateral_acceleration, wanted_altitude):
        """lateral_acceleration: m/s² to the right, as the guidance wants it."""
        wanted = math.atan2(lateral_acceleration, GRAVITY)
        wanted = max(-MAX_BANK, min(MAX_BANK, wanted))
        change = max(-MAX_ROLL_RATE * dt, min(MAX_ROLL_RATE * dt, (wanted - self.bank) * min(1, dt / 0.25)))
        self.bank += change
        self.heading = wrap(self.heading + GRAVITY * math.tan(self.bank) / self.airspeed * dt)
        climb = max(-MAX_CLIMB, min(MAX_CLIMB, 0.3 * (wanted_altitude - self.altitude)))
        self.climb += (climb - self.climb) * min(1, dt / 1.0)
        for process in (*self.gusts, *self.shake):
            process.step(dt)
        before, attitude_before = self.velocity, (self.roll, self.pitch, self.yaw)
        self.velocity = self._velocity()
        self.acceleration = tuple((now - then) / dt for now, then in zip(self.velocity, before))
        self.north += (self.velocity[0] + before[0]) / 2 * dt
        self.east += (self.velocity[1] + before[1]) / 2 * dt
        self.altitude -= (self.velocity[2] + before[2]) / 2 * dt
        self.roll, self.pitch, self.yaw = self._attitude()
        turned = [wrap(now - then) / dt for now, then in zip((self.roll, self.pitch, self.yaw), attitude_before)]
        self.rates = body_rates(turned, self.roll, self.pitch)
        self._inertial.append((*self.specific_force(), *self.rates))
        del self._inertial[:-50]

    def take_inertial(self):
        """Specific force and turn rate as a sensor with an anti-aliasing filter has them: means since the last call."""
        taken, self._inertial = self._inertial or [(*self.specific_force(), *self.rates)], []
        means = [sum(column) / len(taken) for column in zip(*taken)]
        return means[:3], means[3:]

    def specific_force(self):
        """What accelerometers feel, in body axes (forward, right, down)."""
        n, e, d = self.acceleration
        return rotate_to_body((n, e, d - GRAVITY), self.roll, self.pitch, self.yaw)

    def _velocity(self):
        """North, east, down over ground."""
        flat = math.sqrt(max(0.0, self.airspeed ** 2 - self.climb ** 2))
        return (flat * math.cos(self.heading) + self.wind[0] + self.gusts[0].value,
                flat * math.sin(self.heading) + self.wind[1] + self.gusts[1].value, -self.climb)

    def _attitude(self):
        pitch = math.asin(max(-0.5, min(0.5, self.climb / self.airspeed))) + ANGLE_OF_ATTACK
        return (self.bank + self.shake[0].value, pitch + self.shake[1].value, wrap(self.heading + self.shake[2].value))


def body_rates(turned, roll, pitch):
    """The turn about the body's axes, from the rates of roll, pitch and yaw."""
    r, p, y = turned
    return (r - y * math.sin(pitch), p * math.cos(roll) + y * math.cos(pitch) * math.sin(roll),
            -p * math.sin(roll) + y * math.cos(pitch) * math.cos(roll))


def rotate_to_body(vector, roll, pitch, yaw):
    n, e, d = vector
    x = n * math.cos(yaw) + e * math.sin(yaw)
    y = -n * math.sin(yaw) + e * math.cos(yaw)
    x, z = x * math.cos(pitch) - d * math.sin(pitch), x * math.sin(pitch) + d * math.cos(pitch)
    return x, y * math.cos(roll) + z * math.sin(roll), -y * math.sin(roll) + z * math.cos(roll)
