"""PX4's local frame: azimuthal equidistant on a sphere, src/lib/geo/geo.cpp (MapProjection)."""
import math

RADIUS_M = 6371000.0


class MapProjection:
    def __init__(self, lat_deg, lon_deg):
        self.lat_deg, self.lon_deg = lat_deg, lon_deg
        self.lat, self.lon = math.radians(lat_deg), math.radians(lon_deg)

    def reproject(self, north, east):
        """(lat_deg, lon_deg) of a place in the local frame."""
        x, y = north / RADIUS_M, east / RADIUS_M
        c = math.hypot(x, y)
        if c == 0:
            return self.lat_deg, self.lon_deg
        sin_c, cos_c, sin_lat, cos_lat = math.sin(c), math.cos(c), math.sin(self.lat), math.cos(self.lat)
        lat = math.asin(cos_c * sin_lat + x * sin_c * cos_lat / c)
        lon = self.lon + math.atan2(y * sin_c, c * cos_lat * cos_c - x * sin_lat * sin_c)
        return math.degrees(lat), math.degrees(lon)
