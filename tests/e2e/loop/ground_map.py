"""Places on a picture of the ground, as SVG."""
import math

UNIT = 1000.0  # the picture's width in the drawing


class GroundMap:
    def __init__(self, box):
        """box: west, south, east, north in degrees; small enough to be flat."""
        self.west, self.south, self.east, self.north = box
        self.shrink = math.cos(math.radians((self.south + self.north) / 2))
        self.width = UNIT
        self.height = UNIT * (self.north - self.south) / ((self.east - self.west) * self.shrink)

    def point(self, lat, lon):
        return (self.width * (lon - self.west) / (self.east - self.west),
                self.height * (self.north - lat) / (self.north - self.south))

    def line(self, kind, places, closed=False):
        """places: (seconds, lat, lon); None where the line is broken."""
        steps, pen_up = [], True
        for place in places:
            if place is None:
                pen_up = True
                continue
            x, y = self.point(*place[1:])
            steps.append(f"{'M' if pen_up else 'L'}{x:.1f} {y:.1f}")
            pen_up = False
        return f'<path class="track {kind}" d="{"".join(steps)}{"Z" if closed else ""}"/>'
