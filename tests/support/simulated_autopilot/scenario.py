"""What happens when: "60:gps-denied", "120:gps-step=300", "180:gps-drag=2@90", "240:gps-recover"…"""
import math

ACTIONS = {
    "gps-denied": None,     # the own receiver has no fix
    "gps-step": 300.0,      # its position moves by so many metres at once
    "gps-drag": 2.0,        # and by so many metres a second
    "gps-recover": None,    # it recovers
    "link-cut": None,       # the link to the companion carries nothing, either way
    "link-restore": None,
    "clock-step": 3600.0,   # the autopilot's UTC jumps by so many seconds
    "camera-cut": None,     # the truth stops, so that the renderer has nothing to show
    "camera-restore": None,
    "compass": 9.0,         # it deviates by up to so many degrees, most on the course of the bearing
    "reboot": None,         # the time since boot restarts
}
DEFAULT_BEARING = 70.0


class Event:
    def __init__(self, time_s, action, value, bearing_deg):
        self.time_s, self.action, self.value, self.bearing_deg = time_s, action, value, bearing_deg

    def __str__(self):
        return self.action if self.value is None else f"{self.action}={self.value:g}@{self.bearing_deg:g}"

    @property
    def bearing(self):
        return math.radians(self.bearing_deg)


def parse_event(text):
    """SECONDS:ACTION[=VALUE[@BEARING]]. ValueError says what is wrong."""
    time, colon, rest = text.partition(":")
    action, equals, value = rest.partition("=")
    if not colon or action not in ACTIONS:
        raise ValueError(f"'{text}': expected SECONDS:ACTION[=VALUE[@BEARING]] with an action of {', '.join(ACTIONS)}")
    number, _, bearing = value.partition("@")
    if equals and ACTIONS[action] is None:
        raise ValueError(f"'{text}': {action} takes no value")
    event = Event(float(time), action, float(number) if equals else ACTIONS[action],
                  float(bearing) if bearing else DEFAULT_BEARING)
    if not all(math.isfinite(n) for n in (event.time_s, event.value or 0, event.bearing_deg)) or event.time_s < 0:
        raise ValueError(f"'{text}': numbers must be finite, and times not negative")
    return event


class Scenario:
    def __init__(self, events):
        self.events = sorted(events, key=lambda event: event.time_s)
        self.next = 0

    def due(self, now_s):
        """The events that have become due, each once."""
        first = self.next
        while self.next < len(self.events) and self.events[self.next].time_s <= now_s:
            self.next += 1
        return self.events[first:self.next]
