"""Between degrees and metres around an origin."""
import math

A = 6378137.0
E2 = 6.69437999014e-3


class LocalPlane:
    """North and east metres from an origin, with the ellipsoid's radii there. Both directions are each other's exact
    inverse, so that all positions of a flight agree; distances are true to 0.1 % within ten kilometres."""

    def __init__(self, lat_deg, lon_deg):
        self.lat_deg, self.lon_deg = lat_deg, lon_deg
        s = math.sin(math.radians(lat_deg))
        w = 1 - E2 * s * s
        self.metres_per_lat = math.radians(1) * A * (1 - E2) / w ** 1.5
        self.metres_per_lon = math.radians(1) * A / math.sqrt(w) * math.cos(math.radians(lat_deg))

    def to_plane(self, lat_deg, lon_deg):
        return (lat_deg - self.lat_deg) * self.metres_per_lat, (lon_deg - self.lon_deg) * self.metres_per_lon

    def to_degrees(self, north, east):
        return self.lat_deg + north / self.metres_per_lat, self.lon_deg + east / self.metres_per_lon


def wrap(angle):
    """Into (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)
