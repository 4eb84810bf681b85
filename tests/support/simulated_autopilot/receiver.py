"""The aircraft's own GPS receiver, and what may be done to it: denied, moved by a step, dragged off, restored."""
import math

from .gauss_markov import GaussMarkov


class GpsSample:
    """One measurement of a receiver. Unknown values are None. place is (north, east), velocity north, east, down."""

    def __init__(self, fix_type, north=0.0, east=0.0, altitude=0.0, velocity=None, h_acc=None, v_acc=None, s_acc=None,
                 hdop=99.99, satellites=0):
        self.fix_type, self.north, self.east, self.altitude, self.velocity = fix_type, north, east, altitude, velocity
        self.h_acc, self.v_acc, self.s_acc, self.hdop, self.satellites = h_acc, v_acc, s_acc, hdop, satellites


class Receiver:
    PERIOD = 0.2

    def __init__(self, random):
        self.random = random
        self.drift = (GaussMarkov(random, 0.9, 60), GaussMarkov(random, 0.9, 60), GaussMarkov(random, 1.8, 60))
        self.denied = False
        self.offset = [0.0, 0.0]
        self.drag = (0.0, 0.0)

    def happen(self, event):
        """What a scenario does to it; any other event leaves it alone."""
        north, east = ((event.value or 0) * share for share in (math.cos(event.bearing), math.sin(event.bearing)))
        if event.action == "gps-denied":
            self.denied = True
        elif event.action == "gps-step":
            self.offset = [self.offset[0] + north, self.offset[1] + east]
        elif event.action == "gps-drag":
            self.drag = (north, east)
        elif event.action == "gps-recover":
            self.denied, self.offset, self.drag = False, [0.0, 0.0], (0.0, 0.0)

    def sample(self, plane):
        """Once every PERIOD. A spoofer reports velocities consistent with its positions."""
        for process in self.drift:
            process.step(self.PERIOD)
        for axis in (0, 1):
            self.offset[axis] += self.drag[axis] * self.PERIOD
        if self.denied:
            return GpsSample(1)
        white = [self.random.gauss(0, 0.2) for _ in range(6)]
        velocity = tuple(v + w / 4 + d for v, w, d in zip(plane.velocity, white[3:], (*self.drag, 0.0)))
        return GpsSample(3, plane.north + self.offset[0] + self.drift[0].value + white[0],
                         plane.east + self.offset[1] + self.drift[1].value + white[1],
                         plane.altitude + self.drift[2].value + white[2], velocity, 1.2, 2.2, 0.3, 0.8, 14)
