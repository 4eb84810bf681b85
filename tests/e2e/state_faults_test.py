#!/usr/bin/env python3
"""nadird started on disks that are full, read-only or torn, on a taken port, with a wrong clock, and killed between any two
writes: it always runs, tells each fault once, and its recovery. Real disks (tmpfs, where this user may mount), the built
programs. docs/acceptance.md."""
import http.client
import itertools
import json
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import time
import unittest
import urllib.request

from loop.ports import free_port
from support import AT, NADIRD, EndToEnd, main

SUPPORT = pathlib.Path(__file__).resolve().parent.parent / "support"
YEAR_S = 365 * 86400
KILLED_STEPS = 30  # create, write, sync, rename … of every file of a start, and of the next second
PATIENCE_S = 120  # only so that a service that hangs fails the test


def epoch(text):
    return int(time.mktime(time.strptime(text, "%Y-%m-%dT%H:%M:%SZ"))) - time.timezone


class Service:
    """nadird, running; what it has written to its log."""

    def __init__(self, command, environment, port):
        self.port = port
        self.process = subprocess.Popen([str(word) for word in command], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                        stderr=subprocess.PIPE, env=environment)
        os.set_blocking(self.process.stderr.fileno(), False)
        self.log = ""

    def read(self):
        if not self.process.stderr.closed:
            self.log += (self.process.stderr.read() or b"").decode(errors="replace")
        return self.log

    def wait_for(self, condition):
        """What the condition returns once that is true; None when it never is, or the service has ended."""
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until and self.process.poll() is None:
            self.read()
            try:
                if met := condition():
                    return met
            except (OSError, http.client.HTTPException):
                pass  # not there yet, or slow to answer
            time.sleep(0.05)
        self.read()
        return None

    def log_contains(self, text):
        return self.wait_for(lambda: text in self.log)

    def get(self, path):
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=5) as answer:
            return json.load(answer)

    def has_package(self):
        return self.wait_for(lambda: self.get("/v1/package")["accepted"])

    def end(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        code = self.process.wait(PATIENCE_S)  # again: the same
        self.read()
        self.process.stderr.close()
        return code


class StateFaults(EndToEnd):
    def setUp(self):
        super().setUp()
        for name in ("step_clock", "die_at_write"):
            built = subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", self.folder / f"{name}.so", SUPPORT / f"{name}.c",
                                    "-ldl"], capture_output=True, check=False)
            if built.returncode != 0:
                self.skipTest("no C compiler for the shims")
        self.keys()
        self.package = self.build()
        (self.folder / "frames").mkdir()
        (self.folder / "link.key").write_text("5a" * 32 + "\n")
        (self.folder / "link.key").chmod(0o600)
        (self.folder / "airframe.json").write_text(json.dumps({
            "format": "nadir.airframe/1", "airframe": "mini-07", "camera": {"model": "pinhole", "width": 640, "height": 480,
            "fx": 500, "fy": 500, "cx": 319.5, "cy": 239.5}}))
        self.state = self.folder / "state"

    def make_keys(self, folder):
        for name in ("root", "signer", "tile"):
            self.good("keys", "create", "--out", folder / name)
        self.good("keys", "root", "--root-key", folder / "root.key.pem", "--package-signer", folder / "signer.pub.pem",
                  "--tile-signer", f"mini-07={folder / 'tile.pub.pem'}", "--expires", "2035-01-01", "--out",
                  folder / "root.json")

    def environment(self, clock_s=0, **more):
        """clock_s: how far the clock is off from a day on which the package is valid."""
        step = self.folder / f"step{clock_s}"
        step.write_bytes(struct.pack("<q", epoch(AT) - int(time.time()) + clock_s))
        libraries = [str(self.folder / "step_clock.so")]
        if "NADIR_DIE_AT" in more:
            libraries.append(str(self.folder / "die_at_write.so"))
        return {**os.environ, "LD_PRELOAD": ":".join(libraries), "NADIR_STEP_CLOCK": str(step), **more}

    def start(self, *more, clock_s=0, port=None, **environment):
        port = port or free_port(socket.SOCK_STREAM)
        service = Service([NADIRD, "--package", self.package, "--trust", self.folder / "root.json", "--airframe",
                           self.folder / "airframe.json", "--state", self.state, "--camera", self.folder / "frames",
                           "--autopilot", "udpin:127.0.0.1:0", "--listen", f"127.0.0.1:{port}", "--memory-mb", 0,
                           "--signing-key", self.folder / "link.key", *more], self.environment(clock_s, **environment), port)
        self.addCleanup(service.end)
        return service

    def small_disk(self, options="size=256k"):
        folder = self.folder / "disk"
        folder.mkdir()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], capture_output=True, check=False)
        if mounted.returncode != 0:
            self.skipTest("LOUDLY: this user may not mount a tmpfs; full and read-only disks are not tried")
        self.addCleanup(subprocess.run, ["umount", "--lazy", folder], check=False)
        return folder

    @staticmethod
    def fill(folder):
        with open(folder / "ballast", "wb", buffering=0) as file:
            for size in (4096, 1):
                try:
                    while True:
                        file.write(bytes(size))
                except OSError:
                    pass

    def reported_once(self, service, part):
        """Failure, then recovery, in the system log and in the events of the page."""
        self.assertTrue(service.log_contains(f"{part}: works again"), service.read())
        self.assertEqual(1, service.log.count(f"{part}: failed"), service.log)
        self.assertEqual(1, service.log.count(f"{part}: works again"), service.log)
        events = service.wait_for(lambda: len(found := self.events(service, part)) >= 2 and found)
        self.assertEqual(["warning", "info"], [event["severity"] for event in events or ()])

    @staticmethod
    def events(service, part):
        with urllib.request.urlopen(f"http://127.0.0.1:{service.port}/v1/events", timeout=5) as stream:
            lines = itertools.takewhile(lambda line: line != "event: state", (line.decode().rstrip() for line in stream))
            logs = [json.loads(line[6:]) for line in lines if line.startswith("data: ")]
        return [event for event in logs if event.get("kind") == part]

    def test_state_disk_full(self):
        disk = self.small_disk()
        self.state = disk / "state"
        self.fill(disk)
        service = self.start()
        self.assertTrue(service.has_package(), service.read())
        self.assertTrue(service.log_contains("state directory: failed"), service.log)
        self.assertTrue(service.log_contains("No space left on device"), service.log)
        (disk / "ballast").unlink()
        self.reported_once(service, "state directory")
        self.assertEqual(0, service.end(), service.log)
        for file in ("acceptance.json", "aircraft.json", "flight.json", "signing-time"):
            self.assertTrue((self.state / file).exists(), file)

    def test_state_disk_read_only(self):
        self.assertEqual(0, self.accepted().end())
        disk = self.small_disk()
        self.state.rename(self.folder / "kept")
        subprocess.run(["cp", "-a", self.folder / "kept", disk / "state"], check=True)
        self.state = disk / "state"
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
        service = self.start(clock_s=-YEAR_S)  # the same boot: resumed
        self.assertTrue(service.has_package(), service.read())
        self.assertTrue(service.log_contains("state directory: failed"), service.log)
        subprocess.run(["mount", "-o", "remount,rw", disk], check=True)
        self.reported_once(service, "state directory")
        self.assertEqual(0, service.end(), service.log)

    def test_recorder_and_candidates_disk_full(self):
        disk = self.small_disk()
        self.fill(disk)
        service = self.start("--record", disk / "record", "--candidates", disk / "tiles", "--tile-key",
                             self.folder / "tile.key.pem")
        self.assertTrue(service.has_package(), service.read())
        for part in ("recorder's disk", "candidate tiles"):
            self.assertTrue(service.log_contains(f"{part}: failed"), service.log)
        (disk / "ballast").unlink()
        for part in ("recorder's disk", "candidate tiles"):
            self.reported_once(service, part)
        self.assertTrue(service.wait_for(lambda: service.get("/v1/state")["recorder"]["state"] == "recording"))
        self.assertEqual(0, service.end(), service.log)

    def test_candidate_store_torn(self):
        self.assertEqual(0, self.accepted("--candidates", self.folder / "tiles", "--tile-key",
                                          self.folder / "tile.key.pem").end())
        store = self.folder / "tiles" / "tiles.mbtiles"
        whole = store.read_bytes()
        for size in (1, 100, len(whole) // 2, len(whole) - 1):
            store.write_bytes(whole[:size] + b"\x7f" * 50)
            service = self.start("--candidates", self.folder / "tiles", "--tile-key", self.folder / "tile.key.pem")
            self.assertTrue(service.has_package(), f"{size}: {service.read()}")
            if size < len(whole) - 1:  # the last byte of an empty page means nothing
                self.assertTrue(service.log_contains("candidate tiles: failed"), f"{size}: {service.log}")
            self.assertEqual(0, service.end(), service.log)

    def test_port_taken(self):
        with socket.socket() as other:
            other.bind(("127.0.0.1", 0))
            other.listen()
            service = self.start(port=other.getsockname()[1])
            self.assertTrue(service.log_contains("API: failed"), service.read())
            self.assertTrue(service.log_contains("Address already in use"), service.log)
        self.assertTrue(service.has_package(), service.read())
        self.reported_once(service, "API")
        self.assertEqual(0, service.end(), service.log)

    def test_signing_time_torn(self):
        self.state.mkdir()
        (self.state / "signing-time").write_text("12345")
        service = self.start()
        self.assertTrue(service.has_package(), service.read())
        self.reported_once(service, "signing time")
        self.assertEqual(0, service.end(), service.log)
        self.assertTrue(re.fullmatch(r"\d+\n", (self.state / "signing-time").read_text()))

    def accepted(self, *more):
        service = self.start(*more)
        self.assertTrue(service.has_package(), service.read())
        self.assertTrue(service.wait_for((self.state / "flight.json").exists))
        return service

    def test_clocks(self):
        self.assertEqual(0, self.accepted().end())
        for clock_s in (-10, -600, -YEAR_S, 2 * YEAR_S):
            service = self.start(clock_s=clock_s)
            self.assertTrue(service.has_package(), f"{clock_s}: {service.read()}")
            self.assertTrue(service.log_contains("resumed as accepted"), service.log)
            self.assertEqual(0, service.end())

    def test_killed_at_every_write(self):
        """Each start has the package, wherever the one before died; the files are the old or the new ones."""
        for step in range(1, KILLED_STEPS + 1):
            dying = self.start(NADIR_DIE_AT=str(step), NADIR_DIE_IN=str(self.state))
            self.assertEqual(-signal.SIGKILL, dying.process.wait(PATIENCE_S), dying.read())
            service = self.start()
            self.assertTrue(service.has_package(), f"killed at {step}: {service.read()}")
            self.assertNotIn(": failed", service.log, f"killed at {step}")
            self.assertEqual(0, service.end())
            self.assertEqual([], [path.name for path in self.state.iterdir() if path.name.endswith(".tmp")])
            for path in self.state.iterdir():
                path.unlink()  # the next one begins as a new aircraft

    def test_only_wrong_usage_is_2(self):
        for wrong in (["--nonsense"], ["--autopilot", "carrier:pigeon"]):
            self.assertEqual(2, self.start(*wrong).process.wait(PATIENCE_S))
        (self.folder / "link.key").chmod(0o644)
        self.assertEqual(2, self.start().process.wait(PATIENCE_S))
        (self.folder / "link.key").chmod(0o600)
        (self.folder / "link.key").rename(self.folder / "gone")
        self.assertEqual(70, self.start().process.wait(PATIENCE_S))
        (self.folder / "gone").rename(self.folder / "link.key")
        self.state = self.folder / "another state"  # nothing to resume
        (self.folder / "root.json").rename(self.folder / "gone")
        service = self.start()
        self.assertTrue(service.wait_for(lambda: not service.get("/v1/package")["accepted"]), service.read())
        (self.folder / "gone").rename(self.folder / "root.json")
        self.assertTrue(service.has_package(), "the root is back: " + service.read())
        self.assertEqual(0, service.end())


if __name__ == "__main__":
    main()
