"""The planned track: a closed circuit of waypoints with rounded corners, as points every few metres."""
import math

SPACING = 4.0
ALL_BEYOND = 120.0


class Plan:
    def __init__(self, corners, radius):
        """corners: (north, east) metres, at least three. radius: of the turns, smaller where the legs are short."""
        if len(corners) < 3:
            raise ValueError("a circuit has at least three corners")
        self.points = _resample(_rounded(corners, radius))

    def __len__(self):
        return len(self.points)

    def point(self, index):
        return self.points[index % len(self.points)]

    def direction(self, index):
        (n0, e0), (n1, e1) = self.point(index), self.point(index + 1)
        return math.atan2(e1 - e0, n1 - n0)

    def nearest(self, north, east, around=None):
        """Index of the nearest point. around: where it was last; only if it is not near there any more, all are tried."""
        if around is not None:
            index = min(range(around - 5, around + 20), key=lambda i: _square(self.point(i), north, east))
            if _square(self.point(index), north, east) < ALL_BEYOND ** 2:
                return index % len(self.points)
        return min(range(len(self.points)), key=lambda i: _square(self.points[i], north, east))

    def deviation(self, north, east, around=None):
        """Distance from the planned track, and the index of the nearest point."""
        index = self.nearest(north, east, around)
        return min(_to_segment(self.point(i), self.point(i + 1), north, east) for i in (index - 1, index)), index

    def length(self):
        return sum(math.dist(self.point(i), self.point(i + 1)) for i in range(len(self.points)))


def _square(point, north, east):
    return (point[0] - north) ** 2 + (point[1] - east) ** 2


def _to_segment(a, b, north, east):
    dn, de = b[0] - a[0], b[1] - a[1]
    square = dn * dn + de * de
    t = 0 if square == 0 else min(1, max(0, ((north - a[0]) * dn + (east - a[1]) * de) / square))
    return math.hypot(north - a[0] - t * dn, east - a[1] - t * de)


def _rounded(corners, radius):
    """The circuit with an arc at each corner that touches both legs; at most half of a leg goes into an arc."""
    result = []
    count = len(corners)
    for i, corner in enumerate(corners):
        before, after = corners[i - 1], corners[(i + 1) % count]
        leg_in, leg_out = math.dist(before, corner), math.dist(corner, after)
        if leg_in < 1 or leg_out < 1:
            raise ValueError("two waypoints at the same place")
        u = ((corner[0] - before[0]) / leg_in, (corner[1] - before[1]) / leg_in)
        v = ((after[0] - corner[0]) / leg_out, (after[1] - corner[1]) / leg_out)
        turn = math.atan2(u[0] * v[1] - u[1] * v[0], u[0] * v[0] + u[1] * v[1])
        if abs(turn) < 1e-6:
            result.append(corner)
            continue
        tangent = min(radius * math.tan(abs(turn) / 2), 0.49 * leg_in, 0.49 * leg_out)
        r = tangent / math.tan(abs(turn) / 2)
        start = (corner[0] - u[0] * tangent, corner[1] - u[1] * tangent)
        side = math.copysign(1, turn)
        centre = (start[0] - side * u[1] * r, start[1] + side * u[0] * r)
        steps = max(2, int(abs(turn) * r / SPACING) + 1)
        for k in range(steps + 1):
            angle = turn * k / steps
            dn, de = start[0] - centre[0], start[1] - centre[1]
            result.append((centre[0] + dn * math.cos(angle) - de * math.sin(angle),
                           centre[1] + dn * math.sin(angle) + de * math.cos(angle)))
    return result


def _resample(points):
    result = []
    for a, b in zip(points, points[1:] + points[:1]):
        steps = max(1, math.ceil(math.dist(a, b) / SPACING))
        result += [(a[0] + (b[0] - a[0]) * k / steps, a[1] + (b[1] - a[1]) * k / steps) for k in range(steps)]
    return result
