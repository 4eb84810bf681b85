"""What the tests of the simulated autopilot share."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "support"))
from pymavlink.dialects.v20 import ardupilotmega as dialect

from simulated_autopilot.link import Link
from simulated_autopilot.vehicle import Options, Vehicle

# A rectangle of 1100 m by 600 m.
CORNERS = [(48.79, 14.02), (48.79, 14.035), (48.7955, 14.035), (48.7955, 14.02)]
UNIX_US = 1_750_000_000_000_000


class Wire:
    """Both ends of a transport in memory."""

    def __init__(self):
        self.out, self.back = bytearray(), bytearray()

    def write(self, data):
        self.out += data

    def read(self):
        data, self.back = bytes(self.back), bytearray()
        return data


class Companion:
    """The other end of a Wire: sends messages, reads what came."""

    def __init__(self, wire, key=None):
        self.wire = wire
        self.mav = dialect.MAVLink(None, srcSystem=1, srcComponent=191)
        self.mav.robust_parsing = True
        if key is not None:
            self.mav.signing.secret_key, self.mav.signing.sign_outgoing = key, True
            self.mav.signing.timestamp = 1

    def send(self, message):
        self.wire.back += message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256

    def read(self):
        data, self.wire.out = bytes(self.wire.out), bytearray()
        return self.mav.parse_buffer(data) or []


def gps_input(lat_deg=48.79, lon_deg=14.02, fix_type=3, gps_id=0, h_acc=3.0, ignore=0, velocity=(0, 0, 0), **changes):
    fields = dict(time_usec=0, gps_id=gps_id, ignore_flags=ignore, time_week_ms=0, time_week=0, fix_type=fix_type,
                  lat=round(lat_deg * 1e7), lon=round(lon_deg * 1e7), alt=600, hdop=1, vdop=1.5, vn=velocity[0],
                  ve=velocity[1], vd=velocity[2], speed_accuracy=0.5, horiz_accuracy=h_acc, vert_accuracy=5,
                  satellites_visible=10)
    return dialect.MAVLink_gps_input_message(**{**fields, **changes})


def vehicle(events=(), key=None, **changes):
    """A Vehicle, and the companion at the other end of its link."""
    wire = Wire()
    link = Link(wire, key, unix_s=lambda: UNIX_US * 1e-6)
    options = Options(corners=CORNERS, altitude=600, unix_us=UNIX_US, events=list(events), **changes)
    return Vehicle(options, link), Companion(wire, key)


def fly(aircraft, seconds, each_step=lambda: None):
    until = aircraft.now_s + seconds
    while aircraft.now_s < until - 1e-9:
        each_step()
        aircraft.step()


class TruthfulCompanion:
    """Gives the true position as GPS_INPUT ten times a second, moved by `offset` (north, east)."""

    def __init__(self, aircraft, companion, h_acc=3.0):
        self.aircraft, self.companion, self.h_acc = aircraft, companion, h_acc
        self.offset, self.fix_type, self.period = [0.0, 0.0], 3, 0.1
        self.next_s = 0.0
        self.speed_accuracy = 0.5

    def __call__(self):
        if self.aircraft.now_s < self.next_s:
            return
        self.next_s = self.aircraft.now_s + self.period
        plane = self.aircraft.plane
        lat, lon = self.aircraft.local.to_degrees(plane.north + self.offset[0], plane.east + self.offset[1])
        self.companion.send(gps_input(lat, lon, self.fix_type, h_acc=self.h_acc, velocity=plane.velocity,
                                      speed_accuracy=self.speed_accuracy))
