#!/usr/bin/env python3
"""The uploader against a service that fails in every way, killed at every transition: nothing is lost, nothing counts
twice.

usage: faults_test.py TEST_KILLED_SYNC TEST_MAKE_CANDIDATES NADIR
"""
import json
import pathlib
import random
import shutil
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from fault_server import FaultServer, Faults  # noqa: E402
from fault_service import Service  # noqa: E402
from support import TEMPORARY, Flight, discrepancies, push, sync, tiles  # noqa: E402

KILLED, MAKE = sys.argv[1], sys.argv[2]
KILL = -9
TRANSITIONS = ("announce", "pack-begins", "pack-waits", "pack-sent", "complete", "verdicts", "delay", "forgotten", "recover")
POINTS = ([f"{name}:{when}" for name in TRANSITIONS for when in ("before", "after")]
          + [f"{what}:{method}" for what in ("request", "reply") for method in ("POST", "PATCH", "HEAD", "GET")])


class Killed(unittest.TestCase):
    COUNT = 40

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(dir=TEMPORARY)
        cls.addClassCleanup(cls.folder.cleanup)
        cls.flight = Flight(cls.folder.name, MAKE, cls.COUNT, 30_000)
        cls.staged = pathlib.Path(cls.folder.name) / "staged"
        result = sync(KILLED, "stage", cls.flight.candidates, "--outbox", cls.staged, "--key", cls.flight.key)
        assert result.returncode == 0, result.stderr

    def outbox(self, name):
        return pathlib.Path(shutil.copytree(self.staged, pathlib.Path(self.folder.name) / name))

    def server(self, **faults):
        server = FaultServer(faults=Faults(**faults))
        self.addCleanup(server.stop)
        return server

    def test_at_every_transition_and_request(self):
        for point in POINTS:
            with self.subTest(point):
                outbox = self.outbox(point.replace(":", "-"))
                # One cut makes it wait and ask for the offset; one loss of memory makes it announce again.
                forgets = point.startswith("forgotten")
                server = self.server(**({"rate": 1.0, "kinds": ("forget",), "most": 2} if forgets else {"cuts": [300_000]}))
                if point.startswith("recover"):
                    self.assertEqual(KILL, push(KILLED, outbox, server.url, kill_at="pack-begins:after").returncode)
                result = push(KILLED, outbox, server.url, kill_at=point)
                self.assertEqual(KILL, result.returncode, result.stderr)
                self.assertIn(f"killed at {point}", result.stderr)
                result = push(KILLED, outbox, server.url)
                self.assertEqual(0, result.returncode, result.stderr)
                self.assertEqual([], discrepancies(outbox, server.service, self.COUNT))

    def test_while_staging(self):
        for point in ("stage:before", "stage:after", "seal:before", "seal:after"):
            with self.subTest(point):
                outbox = pathlib.Path(self.folder.name) / point.replace(":", "-")
                arguments = ("stage", self.flight.candidates, "--outbox", outbox, "--key", self.flight.key)
                self.assertEqual(KILL, sync(KILLED, *arguments, kill_at=point).returncode)
                self.assertEqual(0, sync(KILLED, *arguments, seed=2).returncode)
                self.assertEqual({"SEALED"}, {state for state, _ in tiles(outbox).values()})
                self.assertEqual(self.COUNT, len(tiles(outbox)))
                server = self.server()
                self.assertEqual(0, push(KILLED, outbox, server.url).returncode)
                self.assertEqual([], discrepancies(outbox, server.service, self.COUNT))

    def test_a_restart_resumes_at_the_offset(self):
        outbox, server = self.outbox("offset"), self.server()
        # Two parts of half a MiB have arrived; they are not sent again.
        self.assertEqual(KILL, push(KILLED, outbox, server.url, kill_at="request:PATCH", kill_count=3).returncode)
        before = server.service.received
        result = push(KILLED, outbox, server.url)
        self.assertEqual(0, result.returncode, result.stderr)
        self.assertEqual(1, server.service.requests["HEAD"])
        sizes = 40 * 30_000
        self.assertLess(server.service.received - before, sizes - (1 << 20) + 100_000)


class Faulty(unittest.TestCase):
    def flight(self, count, mean_bytes):
        folder = tempfile.TemporaryDirectory(dir=TEMPORARY)
        self.addCleanup(folder.cleanup)
        flight, outbox = Flight(folder.name, MAKE, count, mean_bytes), pathlib.Path(folder.name) / "outbox"
        result = sync(KILLED, "stage", flight.candidates, "--outbox", outbox, "--key", flight.key, "--json")
        self.assertEqual(0, result.returncode, result.stderr)
        return outbox

    def serve(self, service=None, **faults):
        server = FaultServer(service, Faults(**faults))
        self.addCleanup(server.stop)
        return server

    def until_done(self, outbox, server, dice, kills):
        """Calls push again and again, killed at random points, until it reports that all is done."""
        counts = {KILL: 0}
        for call in range(400):
            kill = dice.randrange(1, 40) if counts[KILL] < kills else None
            result = push(KILLED, outbox, server.url, kill_count=kill, seed=dice.randrange(1 << 30))
            counts[result.returncode] = counts.get(result.returncode, 0) + 1
            if result.returncode == KILL:
                continue
            self.assertIn(result.returncode, (0, 1), result.stderr)
            self.assertTrue(json.loads(result.stdout)["finished"], result.stdout)
            if "PARKED" not in {state for state, _ in tiles(outbox).values()}:
                return counts
            self.assertEqual(0, sync(KILLED, "retry", outbox).returncode)
        self.fail("it does not come to an end")

    def test_every_fault_and_random_kills(self):
        """Also verdicts of every kind; the service's books and the outbox agree in the end."""
        count = 300
        outbox = self.flight(count, 30_000)
        service = Service(part_max=1 << 16, judge=lambda s: "blurred" if s["x"] % 7 == 0 else None,
                          refuse=lambda s: "too_old" if s["x"] % 11 == 0 else None)
        server = self.serve(service, seed=3, rate=0.3, most=100)
        counts = self.until_done(outbox, server, random.Random(3), kills=20)
        self.assertEqual([], discrepancies(outbox, service, count))
        states = {state for state, _ in tiles(outbox).values()}
        self.assertGreaterEqual(states, {"ACCEPTED", "REJECTED", "REFUSED"})
        self.assertEqual({"", "blurred", "too_old"}, {code for _, code in tiles(outbox).values()})
        self.assertGreaterEqual(len(server.faults.done), 8, server.faults.done)
        print(f"{count} tiles, {sum(server.faults.done.values())} faults, {counts[KILL]} kills")

    def test_twenty_cuts_cost_little(self):
        """The bar of 1.1 is the bench's, with 200 MB; here parts are large beside the distance of the cuts."""
        count = 400
        for keeps, most in ((True, 1.1), (False, 1.5)):
            with self.subTest(keeps=keeps):
                outbox, dice = self.flight(count, 60_000), random.Random(5)
                plan = sync(KILLED, "push", outbox, "--to", "http://localhost", "--dry-run", "--json")
                payload = json.loads(plan.stdout)["bytes"]
                server = self.serve(Service(keep_partial=keeps), cuts=[dice.randrange(payload) for _ in range(20)])
                result = push(KILLED, outbox, server.url)
                self.assertEqual(0, result.returncode, result.stderr)
                self.assertEqual([], discrepancies(outbox, server.service, count))
                self.assertGreaterEqual(server.faults.done["cut"], 15)
                self.assertLess(server.service.received, most * payload)

    def test_each_fault_alone(self):
        for kind in ("error_500", "busy_429", "lost_reply", "twice", "wrong_offset", "garbage", "oversized", "forget", "cut",
                     "mangled"):
            with self.subTest(kind):
                outbox = self.flight(20, 30_000)
                server = self.serve(seed=7, rate=0.5, kinds=(kind,), most=6)
                self.until_done(outbox, server, random.Random(1), kills=0)
                self.assertEqual([], discrepancies(outbox, server.service, 20))
                self.assertGreater(server.faults.done[kind], 0)

    def test_a_permanent_fault_ends_at_the_timeout(self):
        outbox = self.flight(5, 5_000)
        server = self.serve(rate=1.0, kinds=("error_500",))
        result = sync(KILLED, "push", outbox, "--to", server.url, "--timeout-s", "3000", "--json")
        self.assertEqual(2, result.returncode)
        self.assertIn("500", json.loads(result.stdout)["waits_for"])
        self.assertEqual({"SEALED"}, {state for state, _ in tiles(outbox).values()})
        server.faults.left = 0
        self.assertEqual(0, push(KILLED, outbox, server.url).returncode)

    def test_permanently_invalid_replies_park_the_batch_for_retry(self):
        outbox = self.flight(5, 5_000)
        server = self.serve(rate=1.0, kinds=("garbage",))
        result = push(KILLED, outbox, server.url)
        self.assertEqual(1, result.returncode)
        self.assertEqual(5, json.loads(result.stdout)["parked"])
        server.faults.left = 0
        self.assertEqual(0, sync(KILLED, "retry", outbox).returncode)
        self.assertEqual(0, push(KILLED, outbox, server.url).returncode)
        self.assertEqual([], discrepancies(outbox, server.service, 5))

    def test_another_flight_over_the_same_tiles_is_not_sent_twice(self):
        outbox = self.flight(20, 20_000)
        server = self.serve()
        self.assertEqual(0, push(KILLED, outbox, server.url).returncode)
        patches = server.service.requests["PATCH"]
        with tempfile.TemporaryDirectory(dir=TEMPORARY) as folder:  # the outbox was lost; the flight is staged afresh
            flight = Flight(folder, MAKE, 20, 20_000)
            again = pathlib.Path(folder) / "outbox"
            sync(KILLED, "stage", flight.candidates, "--outbox", again, "--key", flight.key, seed=9)
            self.assertEqual(0, push(KILLED, again, server.url).returncode)
            self.assertEqual({"DUPLICATE"}, {state for state, _ in tiles(again).values()})
        self.assertEqual(patches, server.service.requests["PATCH"], "their bytes were there")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
