#!/usr/bin/env python3
"""nadir-candidates on a disk that is really full: a tmpfs of a few megabytes, filled to the last byte. Whatever it was doing,
it says so, keeps what it has acknowledged, and goes on by itself once there is room.

usage: full_disk_test.py NADIR NADIR_CANDIDATES MAKE_FLIGHTS
Exit code 77 where this user may not mount a tmpfs.
"""
import hashlib
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE)]
from ground_station import Service, Station, counts, flights_in, settled  # noqa: E402

NADIR, PROGRAM, MAKE = sys.argv[1:4]
TILES = 60
DISK = "size=24m"
PATIENCE_S = 60  # only so that a service that hangs fails the test


def mounted(folder):
    return subprocess.run(["mount", "-t", "tmpfs", "-o", DISK, "tmpfs", folder], capture_output=True, check=False).returncode == 0


class LoggedService(Service):
    """A service whose stderr can be looked at while it runs."""

    def start(self):
        super().start()
        self.text = ""
        os.set_blocking(self.process.stderr.fileno(), False)

    def log(self):
        try:
            while chunk := os.read(self.process.stderr.fileno(), 1 << 16):
                self.text += chunk.decode()
        except BlockingIOError:
            pass
        return self.text


class FullDisk(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.made = pathlib.Path(tempfile.mkdtemp(prefix="nadir-flights."))
        cls.addClassCleanup(shutil.rmtree, cls.made, True)
        subprocess.run([MAKE, cls.made, "2", str(TILES)], check=True)

    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="nadir-full-disk."))
        self.addCleanup(shutil.rmtree, self.folder, True)
        self.data = self.disk = self.folder / "data"
        self.disk.mkdir()
        self.assertTrue(mounted(self.disk))
        self.addCleanup(subprocess.run, ["umount", "--lazy", self.disk], check=False)
        self.service = LoggedService(PROGRAM, self.made, self.data)
        self.addCleanup(self.service.stop)
        self.station = Station(self.service, self.made)
        self.addCleanup(lambda: self.station.close())

    def fill(self):
        """To the last byte."""
        with open(self.disk / "ballast", "ab", buffering=0) as file:
            for size in (1 << 20, 4096, 1):
                try:
                    while True:
                        file.write(bytes(size))
                except OSError:
                    pass
        self.assertEqual(0, shutil.disk_usage(self.disk).free)

    def make_room(self):
        (self.disk / "ballast").unlink()

    def health(self):
        return json.loads(self.station.ask("GET", "/v1/health")[2])

    def wait_for(self, condition, what):
        until = time.monotonic() + PATIENCE_S
        while not condition():
            self.assertLess(time.monotonic(), until, what)
            self.assertIsNone(self.service.process.poll(), "the service has ended")
            time.sleep(0.05)

    def well(self):
        """Everything is written again, and the log says what it lacks: no number is missing from it."""
        self.wait_for(lambda: self.health()["reason"] == "", "a fault that stays")
        lines = [json.loads(line) for line in (self.data / "audit" / "audit.jsonl").read_text().splitlines()]
        self.assertEqual(list(range(1, len(lines) + 1)), [line["n"] for line in lines])
        return lines

    def refused(self, call):
        """507, with the reason and a time to come back."""
        status, headers, body = call()
        self.assertEqual(507, status, body)
        problem = json.loads(body)
        self.assertIn("disk is full", problem["detail"])
        self.assertIn("make room", problem["detail"])
        self.assertTrue(headers["Retry-After"])

    def announce(self, flight):
        batch = (flight / "batch-0.json").read_bytes()
        return self.station.ask("POST", "/v1/uploads", batch, **{"Content-Type": "application/json",
                                                                 "Idempotency-Key": json.loads(batch)["signed"]["batch"]})

    def test_an_announcement(self):
        self.service.start()
        self.fill()
        flight = flights_in(self.made)[0]
        self.refused(lambda: self.announce(flight))
        self.assertEqual("fail", self.health()["status"])
        self.assertIn("the disk is full", self.health()["reason"])
        self.make_room()
        self.assertEqual({"accepted"}, {tile["verdict"] for tile in self.station.judged(self.station.upload(flight))["tiles"]})
        self.well()

    def test_parts_of_a_pack(self):
        """What was acknowledged is there afterwards, and no byte of it is sent again."""
        self.service.start()
        flight = flights_in(self.made)[0]
        upload = self.station.announce(flight / "batch-0.json")["upload_id"]
        pack = sorted(flight.glob("0-*.pack"))[0]
        acknowledged = {}
        send = Station.ask
        parts = 0

        def fill_after_the_first(station, method, path, body=None, **headers):
            nonlocal parts
            parts += method == "PATCH"
            if method == "PATCH" and parts == 2:
                self.fill()
            return send(station, method, path, body, **headers)

        Station.ask = fill_after_the_first
        try:
            with self.assertRaisesRegex(RuntimeError, "507.*disk is full"):
                self.station.send(upload, pack, part=50_000, acknowledged=acknowledged)
        finally:
            Station.ask = send
        path, offset = next(iter(acknowledged.items()))
        self.assertEqual(50_000, offset)
        self.assertEqual(str(offset), self.station.ask("HEAD", path)[1]["Upload-Offset"])
        self.service.kill()
        self.service.start()  # also on a full disk
        self.assertEqual(str(offset), self.station.ask("HEAD", path)[1]["Upload-Offset"])
        self.assertEqual("fail", self.health()["status"])
        self.make_room()
        self.assertEqual({"accepted"}, {tile["verdict"] for tile in self.station.judged(self.station.upload(flight))["tiles"]})
        self.well()

    def test_a_whole_pack(self):
        """Its last byte has come, and what it holds cannot be noted: the next look at it takes it in."""
        self.service.start()
        flight = flights_in(self.made)[0]
        upload = self.station.announce(flight / "batch-0.json")["upload_id"]
        for pack in sorted(flight.glob("0-*.pack")):
            incoming = self.data / "incoming" / upload
            incoming.mkdir(exist_ok=True)
            digest = hashlib.sha256(pack.read_bytes()).hexdigest()
            shutil.copy(pack, incoming / f"{digest}.{pack.stat().st_size}")
        self.fill()
        self.refused(lambda: self.station.ask("POST", f"/v1/uploads/{upload}/complete"))
        self.service.kill()
        self.service.start()
        self.assertEqual("fail", self.health()["status"])
        self.make_room()
        self.station.complete(upload)
        self.assertEqual({"accepted"}, {tile["verdict"] for tile in self.station.judged(upload)["tiles"]})
        self.well()

    def test_verdicts_votes_and_promotions(self):
        """Evaluation begins on a full disk: nothing is decided, nothing is lost, and it is done once there is room."""
        self.service.start()
        for flight in flights_in(self.made):
            upload = self.station.announce(flight / "batch-0.json")["upload_id"]
            for pack in sorted(flight.glob("0-*.pack")):
                self.station.send(upload, pack)
        self.service.stop()
        # As if it had been killed just after both uploads were complete, before the first verdict.
        subprocess.run(["sqlite3", self.data / "catalogue.sqlite", "UPDATE uploads SET state = 1"], check=True)
        self.fill()
        self.service.start()
        self.wait_for(lambda: "database or disk is full" in self.service.log(), "the service has not tried")
        self.assertEqual("fail", self.health()["status"])
        found = counts(PROGRAM, self.data)
        self.assertEqual((2, 0, 0), (found["uploads"]["judging"], found["tiles"]["accepted"], found["tiles"]["promoted"]), found)
        self.make_room()
        found = settled(PROGRAM, self.data)
        self.assertEqual(2 * TILES, found["tiles"]["accepted"], found)
        self.assertEqual(TILES, found["tiles"]["promoted"], found)
        self.well()

    def test_votes_and_promotions(self):
        """The verdicts are in, the disk is full before the votes."""
        self.service.start()
        for flight in flights_in(self.made):
            self.station.judged(self.station.upload(flight))
        settled(PROGRAM, self.data)
        self.service.stop()
        subprocess.run(["sqlite3", self.data / "catalogue.sqlite",
                        "DELETE FROM votes; UPDATE promotions SET current = 0; UPDATE verdicts SET to_vote = 1"], check=True)
        self.fill()
        self.service.start()
        self.wait_for(lambda: "database or disk is full" in self.service.log(), "the service has not tried")
        self.assertEqual(0, counts(PROGRAM, self.data)["tiles"]["promoted"])
        self.make_room()
        self.wait_for(lambda: counts(PROGRAM, self.data)["tiles"]["promoted"] == TILES, "no promotion")
        self.well()

    def test_the_audit_log_says_what_it_lacks(self):
        self.service.start()
        self.fill()
        for _ in range(60):  # more than what is left of the file's last page
            self.assertEqual(401, self.station.ask("GET", "/v1/reason-codes", Authorization="Bearer " + "x" * 20)[0])
        self.make_room()
        self.wait_for(lambda: "audit.gap" in (self.data / "audit" / "audit.jsonl").read_text(), "no gap is recorded")
        gap = [line for line in self.well() if line["act"] == "audit.gap"]
        self.assertEqual(1, len(gap), gap)
        self.assertGreaterEqual(int(gap[0]["subject"].split()[1]), 10)
        self.assertIn("No space left on device", gap[0]["detail"])

    def test_an_aircrafts_report(self):
        self.service.start()
        report = (flights_in(self.made)[0] / "candidates" / "installed.json").read_bytes()

        def bring():
            return self.station.ask("POST", "/v1/installed", report, **{"Content-Type": "application/json"})

        self.fill()
        self.refused(bring)
        self.make_room()
        self.assertEqual(201, bring()[0])

    def test_a_fault_is_reported_once(self):
        """However long the disk stays full: one line when it comes, one when it goes."""
        self.service.start()
        self.fill()
        self.wait_for(lambda: "the disk is full" in self.service.log(), "no fault is reported")
        time.sleep(11)  # two more rounds of the service's own looks
        self.make_room()
        self.wait_for(lambda: "works again without a fault" in self.service.log(), "no recovery is reported")
        lines = [line for line in self.service.log().splitlines() if not line.startswith("warning:")]
        self.assertEqual(2, len(lines), lines)
        gone = [line for line in self.well() if (line["act"], line["result"]) == ("service.fault", "gone")]
        self.assertEqual(1, len(gone))


if __name__ == "__main__":
    probe = tempfile.mkdtemp(prefix="nadir-mount.")
    allowed = mounted(probe)
    if allowed:
        subprocess.run(["umount", probe], check=False)
    pathlib.Path(probe).rmdir()
    if not allowed:
        print("NOT TESTED: the candidate service on a full disk. This user may not mount a tmpfs; run the test as root.",
              file=sys.stderr)
        sys.exit(77)
    unittest.main(argv=[sys.argv[0]], verbosity=2)
