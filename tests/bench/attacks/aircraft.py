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

from loop.link_endpoint import KEY, LAT, LON, YEAR, LinkEndpoint, gps2, heartbeat, hint, signing_time, telemetry  # noqa: F401

from .shared import free_port


class Autopilot(LinkEndpoint):
    """Sends its telemetry ten times a second from a thread, and records what nadird sends."""

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
    """A context: nadird with a signed package, a folder as camera and a link; a systemd that receives its watchdog messages."""

    def __init__(self, scene, *more, signed=True, package=None, airframe=None, state=None, camera=None, autopilot=False,
                 environment=None, listen=True, link_port=None, armed=False, link=None):
        shared = scene.shared
        self.scene, self.signed, self.armed = scene, signed, armed
        self.state_folder = pathlib.Path(state or scene.folder / "state")
        self.frames = scene.folder / "frames"
        self.frames.mkdir(exist_ok=True)
        self.link_port, self.api_port = link_port or free_port(socket.SOCK_DGRAM), free_port()
        self.url = f"http://127.0.0.1:{self.api_port}"
        self.with_autopilot, self.autopilot, self.endpoints = autopilot, None, []
        self.environment = dict(environment or {})
        self.command = ["--package", package or shared.built(), "--trust", shared.root, "--airframe",
                        airframe or shared.airframe(scene.folder), "--state", self.state_folder, "--camera",
                        camera or f"folder:{self.frames}", "--autopilot", link or f"udpin:127.0.0.1:{self.link_port}", "--memory-mb", 0,
                        *(["--signing-key", shared.keys / "link.key"] if signed else ["--unsigned-link"]),
                        *(["--listen", f"127.0.0.1:{self.api_port}"] if listen else []), *more]
        self.alive = []  # monotonic seconds of WATCHDOG=1
        self.service = None

    def __enter__(self):
        self._watch_systemd()
        self.service = self.scene.start("nadird", *self.command, environment=self.environment)
        if self.with_autopilot:
            self.autopilot = Autopilot(self.link_port, KEY if self.signed else None, self.armed)
            self.endpoints.append(self.autopilot)
        return self

    def __exit__(self, kind, *_):
        for endpoint in self.endpoints:
            endpoint.close()
        self.watching.set()
        if any(other is self.service for _, other in self.scene.started):
            if kind is None:
                self.scene.end(self.service)
            else:
                self.service.running() and self.service.process.kill()

    def _watch_systemd(self):
        self.watching = threading.Event()
        name = f"\0nadir-attacks.{os.getpid()}.{id(self)}"
        notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        notify.bind(name)
        notify.settimeout(0.1)
        self.environment |= {"NOTIFY_SOCKET": "@" + name[1:], "WATCHDOG_USEC": "6000000"}

        def watch():
            while not self.watching.is_set():
                try:
                    if b"WATCHDOG=1" in notify.recv(4096):
                        self.alive.append(time.monotonic())
                except TimeoutError:
                    pass
            notify.close()
        threading.Thread(target=watch, daemon=True).start()

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

    def endpoint(self, **how):
        self.endpoints.append(LinkEndpoint(self.link_port, **how))
        return self.endpoints[-1]

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
