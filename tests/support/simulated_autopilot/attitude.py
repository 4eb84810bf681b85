"""The autopilot's attitude estimate: not the truth, and correlated with its position estimate.

Roll and pitch drift as Gauss-Markov processes. The compass is off by a constant and by a deviation that turns with the course (coefficients B and C
of a ship's compass: sine and cosine of the heading). And as in every filter that is aided by GPS, an acceleration that the
receiver's velocity shows and the accelerometers do not is taken for an error of attitude: of tilt at once, of heading
where there is a horizontal acceleration to turn about, which is in a turn. A fix that runs off bends the attitude that the next
fix is made with.
"""
import math

from .geo import wrap
from .gauss_markov import GaussMarkov

GRAVITY = 9.80665
TILT_TIME_S, HEADING_TIME_S = 10.0, 10.0  # in which the filter takes an attitude's error in, and forgets it
LEAST_ACCELERATION = 1.0  # m/s²: below it GPS does not observe the heading
USUAL_DEVIATION = math.radians(2)  # on the course where it is largest


class AttitudeEstimate:
    def __init__(self, random):
        self._drift = [GaussMarkov(random, math.radians(degrees), 60) for degrees in (0.35, 0.35)]
        self._constant = random.gauss(0, math.radians(1.2))
        self.deviate(USUAL_DEVIATION, random.uniform(-math.pi, math.pi))
        self._leant = [0.0, 0.0]  # tilt to north and east, radians
        self._turned = 0.0
        self._velocity_error = None

    def deviate(self, most, course):
        """The compass' deviation, radians, and the course on which it is that much."""
        self._deviation, self._most_on = most, course

    def step(self, dt, plane, estimated_velocity):
        """estimated_velocity: north, east, the position filter's."""
        for process in self._drift:
            process.step(dt)
        error = [estimated - true for estimated, true in zip(estimated_velocity, plane.velocity)]
        before, self._velocity_error = self._velocity_error or error, error
        feigned = [(now - then) / dt for now, then in zip(error, before)]  # m/s² of apparent acceleration
        for axis in (0, 1):
            self._leant[axis] += (dt * feigned[axis] / GRAVITY - dt * self._leant[axis]) / TILT_TIME_S
        felt = plane.acceleration
        square = felt[0] ** 2 + felt[1] ** 2
        turn = 0.0
        if square > LEAST_ACCELERATION ** 2:
            turn = (felt[0] * feigned[1] - felt[1] * feigned[0]) / square
        self._turned += (dt * turn - dt * self._turned) / HEADING_TIME_S

    def estimate(self, plane):
        """Roll, pitch, yaw."""
        c, s = math.cos(plane.yaw), math.sin(plane.yaw)
        ahead, right = c * self._leant[0] + s * self._leant[1], c * self._leant[1] - s * self._leant[0]
        compass = self._constant + self._deviation * math.cos(plane.yaw - self._most_on)
        return (plane.roll + self._drift[0].value + right, plane.pitch + self._drift[1].value - ahead,
                wrap(plane.yaw + compass + self._turned))
