"""nadird in flight, as far as an attack needs it: a package, a folder as camera, an autopilot that speaks, and rivals."""
import json
import os
import pathlib
import socket
import struct
import threading
import time
import urllib.error
import urllib.request

from pymavlink.dialects.v20 import ardupilotmega as dialect

from .shared import free_port

KEY = bytes.fromhex("5a" * 32)
SIGNING_EPOCH = 1420070400  # 2015-01-01
YEAR = 365 * 86400
LAT, LON = 47.4, 8.5


def signing_time(ahead_s=0):
    return int((time.time() - SIGNING_EPOCH + ahead_s) * 1e5)


class Speaker:
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


class Autopilot(Speaker):
    """Sends its telemetry ten times a second from a thread, and hears what nadird sends."""

    def __init__(self, port, key=None, armed=False):
        super().__init__(port, key=key)
        self.armed, self.begun, self.mute = armed, time.monotonic(), False
        self.stopped = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        number = 0
        while not self.stopped.wait(0.1):
            if not self.mute:
                if number % 5 == 0:
                    self.send(heartbeat(self.armed))
                self.send(*telemetry(self.begun))
                number += 1
            self.read()

    def read(self):
        if threading.current_thread() is not self.thread:
            return self.received
        return super().read()

    def longest_gap_s(self, name, since):
        """Between two such messages since then, and until now."""
        times = [at for at, message in list(self.received) if message.get_type() == name and at >= since]
        return max((b - a for a, b in zip([since, *times], [*times, time.monotonic()])), default=float("inf"))

    def close(self):
        self.stopped.set()
        self.thread.join()
        super().close()


class Aircraft:
    """A context: nadird with a signed package, a folder as camera and a link; a systemd that hears its watchdog."""

    def __init__(self, scene, *more, signed=True, package=None, airframe=None, state=None, camera=None, autopilot=False,
                 environment=None, listen=True, link_port=None, armed=False, link=None):
        shared = scene.shared
        self.scene, self.signed, self.armed = scene, signed, armed
        self.state_folder = pathlib.Path(state or scene.folder / "state")
        self.frames = scene.folder / "frames"
        self.frames.mkdir(exist_ok=True)
        self.link_port, self.api_port = link_port or free_port(socket.SOCK_DGRAM), free_port()
        self.url = f"http://127.0.0.1:{self.api_port}"
        self.with_autopilot, self.autopilot, self.speakers = autopilot, None, []
        self.environment = dict(environment or {})
        self.command = ["--package", package or shared.built(), "--trust", shared.root, "--airframe",
                        airframe or shared.airframe(scene.folder), "--state", self.state_folder, "--camera",
                        camera or f"folder:{self.frames}", "--autopilot", link or f"udpin:127.0.0.1:{self.link_port}", "--memory-mb", 0,
                        *(["--signing-key", shared.keys / "link.key"] if signed else ["--unsigned-link"]),
                        *(["--listen", f"127.0.0.1:{self.api_port}"] if listen else []), *more]
        self.alive = []  # monotonic seconds of WATCHDOG=1
        self.service = None

    def __enter__(self):
        self._hear_watchdog()
        self.service = self.scene.start("nadird", *self.command, environment=self.environment)
        if self.with_autopilot:
            self.autopilot = Autopilot(self.link_port, KEY if self.signed else None, self.armed)
            self.speakers.append(self.autopilot)
        return self

    def __exit__(self, kind, *_):
        for speaker in self.speakers:
            speaker.close()
        self.hearing.set()
        if any(other is self.service for _, other in self.scene.started):
            if kind is None:
                self.scene.end(self.service)
            else:
                self.service.process.kill()

    def _hear_watchdog(self):
        self.hearing = threading.Event()
        name = f"\0nadir-attacks.{os.getpid()}.{id(self)}"
        notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        notify.bind(name)
        notify.settimeout(0.1)
        self.environment |= {"NOTIFY_SOCKET": "@" + name[1:], "WATCHDOG_USEC": "6000000"}

        def hear():
            while not self.hearing.is_set():
                try:
                    if b"WATCHDOG=1" in notify.recv(4096):
                        self.alive.append(time.monotonic())
                except TimeoutError:
                    pass
            notify.close()
        threading.Thread(target=hear, daemon=True).start()

    def longest_silence_s(self, since):
        """Of the watchdog; systemd kills after 6 s."""
        times = [at for at in self.alive if at >= since]
        return max(b - a for a, b in zip([since, *times], [*times, time.monotonic()]))

    # ---- what the API says

    def get(self, path="/v1/state"):
        """The JSON; None when there is no answer."""
        try:
            with urllib.request.urlopen(self.url + path, timeout=5) as answer:
                return json.load(answer)
        except (OSError, ValueError, urllib.error.URLError):
            return None

    def has_package(self):
        self.scene.wait_for(lambda: (self.get("/v1/package") or {}).get("accepted"), 15,
                            f"no package is accepted: {self.service.text()[-200:]}")
        return self

    def connected(self):
        self.scene.wait_for(lambda: (self.get() or {}).get("link", {}).get("connected"), 15,
                            f"the autopilot is not connected: {self.service.text()[-200:]}")
        return self

    def link(self):
        return (self.get() or {}).get("link", {})

    def rejected(self):
        """How many frames the link has refused, for any reason."""
        return sum(self.link().get("rejected_by", {}).values())

    def texts(self):
        """Of the events, with their kinds."""
        return [f"{event.get('kind')}: {event.get('text')}" for event in (self.get() or {}).get("events", [])]

    def speaker(self, **how):
        self.speakers.append(Speaker(self.link_port, **how))
        return self.speakers[-1]

    def flies_on(self, since, what="it"):
        """It answers, sends fixes (or says that it has none) to the autopilot, and feeds its watchdog."""
        scene = self.scene
        scene.holds(self.service.running(), f"nadird has ended: {self.service.text()[-200:]}")
        scene.holds(self.get() is not None, "the API does not answer")
        if self.autopilot is not None:
            gap = self.autopilot.longest_gap_s("GPS_INPUT", since)
            scene.holds(gap < 1.5, f"GPS_INPUT paused for {gap:.1f} s")
        silence = self.longest_silence_s(since)
        scene.holds(silence < 5, f"the watchdog was not fed for {silence:.1f} s: systemd kills after 6")


def plain_request(port, data, patience_s=5.0, until=None):
    """The bytes that come back on a TCP connection."""
    with socket.create_connection(("127.0.0.1", port), timeout=patience_s) as end:
        end.sendall(data)
        received = b""
        try:
            while part := end.recv(65536):
                received += part
                if until is not None and until in received:
                    break
        except OSError:
            pass
        return received


def sse_reader(port):
    """An event stream that is never read: the socket."""
    end = socket.socket()
    end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    end.settimeout(2)
    end.connect(("127.0.0.1", port))
    end.sendall(b"GET /v1/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
    return end
