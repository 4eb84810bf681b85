"""Who speaks MAVLink to nadird beside the simulated autopilot: an end of a UDP link with ids, a key and a clock of its own."""
import socket
import time

from pymavlink.dialects.v20 import ardupilotmega as dialect

KEY = bytes.fromhex("5a" * 32)
SIGNING_EPOCH = 1420070400  # 2015-01-01
YEAR = 365 * 86400
LAT, LON = 47.4, 8.5


def signing_time(ahead_s=0):
    return int((time.time() - SIGNING_EPOCH + ahead_s) * 1e5)


class LinkEndpoint:
    """One end of a UDP link to nadird, with a codec of its own."""

    def __init__(self, port, system=1, component=1, key=None, ahead_s=0, link_id=0):
        self.address = ("127.0.0.1", port)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self.mav.robust_parsing = True
        self.reader = dialect.MAVLink(None)
        self.reader.robust_parsing = True
        if key is not None:
            self.mav.signing.secret_key, self.mav.signing.sign_outgoing, self.mav.signing.link_id = key, True, link_id
            self.mav.signing.timestamp = signing_time(ahead_s)
        self.sent = []  # datagrams
        self.received = []  # (monotonic seconds, message)

    def datagram(self, message):
        data = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        return data

    def send(self, *messages):
        for message in messages:
            self.send_bytes(self.datagram(message))

    def send_bytes(self, data):
        self.sent.append(data)
        try:
            self.socket.sendto(data, self.address)
        except OSError:  # nobody listens at the moment: lost, as on any link
            pass

    def read(self):
        """What has come until now."""
        while True:
            try:
                data = self.socket.recv(65536)
            except OSError:
                return self.received
            for message in self.reader.parse_buffer(data) or []:
                if message.get_type() != "BAD_DATA":
                    self.received.append((time.monotonic(), message))

    def count(self, name, since=0.0):
        return sum(message.get_type() == name and at >= since for at, message in self.read())

    def close(self):
        self.socket.close()


def heartbeat(armed=False):
    return dialect.MAVLink_heartbeat_message(1, 3, 128 if armed else 0, 10, 4, 3)


def gps2(lat=LAT, lon=LON, fix=3):
    return dialect.MAVLink_gps2_raw_message(int(time.time() * 1e6), fix, round(lat * 1e7), round(lon * 1e7), 500_000, 80, 100, 2200, 9000, 12,
                                            0, 0)


def telemetry(begun, lat=LAT, lon=LON, yaw=1.57):
    ms = int((time.monotonic() - begun) * 1000) % (1 << 32)
    return [dialect.MAVLink_system_time_message(int(time.time() * 1e6), ms),
            dialect.MAVLink_attitude_message(ms, 0.0, 0.0, yaw, 0.0, 0.0, 0.0),
            dialect.MAVLink_global_position_int_message(ms, round(lat * 1e7), round(lon * 1e7), 500_000, 100_000, 0, 2200, 0, 9000),
            gps2(lat, lon)]


def hint(target_system=1, target_component=197, lat=LAT, lon=LON, radius_m=200.0):
    return dialect.MAVLink_command_int_message(target_system, target_component, 0, 43003, 0, 0, 0.0, 0.1, radius_m, 0.0,
                                               round(lat * 1e7), round(lon * 1e7), float("nan"))
