"""Steers along the plan by the filter's position estimate: pursuit of a point ahead (Park, Deyst, How 2004)."""
import math

from .geo import wrap
from .plan import SPACING

LOOK_AHEAD_S = 3.6  # at the ground speed


class Guidance:
    def __init__(self, plan):
        self.plan = plan
        self.index = None

    def lateral_acceleration(self, north, east, velocity_north, velocity_east):
        """To the right, m/s²."""
        self.index = self.plan.nearest(north, east, self.index)
        speed = max(5.0, math.hypot(velocity_north, velocity_east))
        ahead = speed * LOOK_AHEAD_S
        target = self.plan.point(self.index + round(ahead / SPACING))
        distance = max(ahead / 3, math.dist(target, (north, east)))
        bearing = math.atan2(target[1] - east, target[0] - north)
        error = wrap(bearing - math.atan2(velocity_east, velocity_north))
        error = max(-math.pi / 2, min(math.pi / 2, error))
        return 2 * speed * speed / distance * math.sin(error)
