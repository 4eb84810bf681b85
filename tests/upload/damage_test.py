#!/usr/bin/env python3
"""What a damaged byte in the outbox costs: the tile that it belongs to, and no other one.

usage: damage_test.py TEST_KILLED_SYNC TEST_MAKE_CANDIDATES NADIR
"""
import json
import pathlib
import sqlite3
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from fault_server import FaultServer  # noqa: E402
from fault_service import Service  # noqa: E402
from support import TEMPORARY, Flight, discrepancies, push, sync, tiles  # noqa: E402

KILLED, MAKE, NADIR = sys.argv[1:4]
COUNT = 12


class Damage(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(dir=TEMPORARY)
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.flight = Flight(self.folder, MAKE, COUNT, 8_000)
        self.calls = 0
        self.begin("outbox")

    def begin(self, name):
        """An outbox and a service that know nothing."""
        self.outbox = self.folder / name
        self.server = FaultServer(Service(at_once=True))
        self.addCleanup(self.server.stop)

    def call(self, code, *arguments, **more):
        self.calls += 1
        result = sync(KILLED, *arguments, seed=self.calls, **more)
        self.assertEqual(code, result.returncode, result.stdout + result.stderr)
        return result.stdout + result.stderr

    def stage(self, code, *more, candidates=None, **environment):
        return self.call(code, "stage", candidates or self.flight.candidates, "--outbox", self.outbox, "--key", self.flight.key, *more,
                         **environment)

    def retry(self, code, **environment):
        return self.call(code, "retry", self.outbox, "--key", self.flight.key, **environment)

    def push(self, code):
        self.calls += 1
        result = push(KILLED, self.outbox, self.server.url, seed=self.calls)
        self.assertEqual(code, result.returncode, result.stdout + result.stderr)
        return json.loads(result.stdout)

    def states(self):
        found = {}
        for state, _ in tiles(self.outbox).values():
            found[state] = found.get(state, 0) + 1
        return found

    def damage(self, *statements):
        """As a disk does it, whatever the triggers say."""
        database = sqlite3.connect(self.outbox / "outbox.sqlite", isolation_level=None)
        triggers = database.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
        for statement in [*(f"DROP TRIGGER {name}" for name, _ in triggers), *statements, *(sql for _, sql in triggers)]:
            database.execute(statement)
        database.close()

    def another_flight(self):
        """Its tiles beside those of the first one, with the same key."""
        candidates = self.folder / "another"
        subprocess.run([MAKE, candidates, self.flight.key, str(COUNT), "8000", "77"], check=True)
        return candidates

    STAGED_DAMAGES = ("UPDATE tile SET sidecar = replace(sidecar, 'mini-07', 'mini-08') WHERE id = 1",
                      "UPDATE blob SET bytes = CAST(bytes || 'x' AS BLOB) WHERE tile = 2",
                      "DELETE FROM blob WHERE tile = 3",
                      "UPDATE tile SET flight = 'another' WHERE id = 4",
                      "UPDATE tile SET signature = x'00' WHERE id = 5",
                      "UPDATE tile SET sidecar = '' WHERE id = 6")

    def test_damaged_staged_tiles_are_set_aside_and_the_others_sealed(self):
        self.stage(-9, kill_at="seal:before")
        self.damage(*self.STAGED_DAMAGES)
        bad = len(self.STAGED_DAMAGES)
        output = self.stage(1)
        self.assertEqual(bad, output.count("outbox.damaged"), output)
        self.assertEqual({"SEALED": COUNT - bad, "DAMAGED": bad}, self.states())
        self.assertEqual(COUNT - bad, self.push(0)["accepted"])
        status = self.call(0, "status", self.outbox, "--failed", 100)
        for word in ("DAMAGED", "its image is missing", "its image is not the one", "its sidecar is not the one",
                     "its row contradicts its sidecar", "its signature is malformed"):
            self.assertIn(word, status)
        # The flight's folder still has them: what is sound takes the damaged ones' place.
        self.assertIn(f"staged {bad} tiles", self.stage(0))
        self.assertEqual(bad, self.push(0)["accepted"])
        self.assertEqual([], discrepancies(self.outbox, self.server.service, COUNT))

    def test_prune_deletes_images_of_damaged_tiles(self):
        self.stage(-9, kill_at="seal:before")
        self.damage("UPDATE blob SET bytes = x'00' WHERE tile = 2")
        self.stage(1)
        self.assertIn("0 tiles", self.call(0, "prune", self.outbox))
        self.assertIn("1 tile,", self.call(0, "prune", self.outbox, "--keep-days", 0))
        self.assertIn("staged 1 tile,", self.stage(0))

    def test_one_damaged_sealed_tile_blocks_nothing_else(self):
        self.stage(0)
        self.stage(0, candidates=self.another_flight())
        self.damage("UPDATE blob SET bytes = x'00' WHERE tile = 5")
        outcome = self.push(1)
        self.assertEqual((COUNT, COUNT), (outcome["accepted"], outcome["parked"]))
        self.assertIn("the outbox is damaged: the image of tile", self.call(1, "status", self.outbox))
        self.assertIn("1 batch can", self.call(0, "retry", self.outbox))
        self.assertEqual(COUNT, self.push(1)["parked"])
        output = self.retry(1)
        self.assertEqual(1, output.count("outbox.damaged"), output)
        self.assertIn(f"{COUNT - 1} tiles put into 1 new batch\n", output)
        self.assertEqual(COUNT - 1, self.push(0)["accepted"])
        self.assertEqual({"ACCEPTED": 2 * COUNT - 1, "DAMAGED": 1}, self.states())
        self.assertIn("staged 1 tile,", self.stage(0))
        self.assertEqual(1, self.push(0)["accepted"])
        self.assertEqual([], discrepancies(self.outbox, self.server.service, 2 * COUNT))

    def test_an_image_damaged_after_the_announcement(self):
        for number, damage in enumerate(("UPDATE blob SET bytes = x'00' WHERE tile = 2", "DELETE FROM blob WHERE tile = 2")):
            with self.subTest(damage):
                self.begin(f"outbox-{number}")
                self.stage(0)
                self.calls += 1
                self.assertEqual(-9, push(KILLED, self.outbox, self.server.url, kill_at="announce:after").returncode)
                self.damage(damage)
                self.assertEqual(COUNT, self.push(1)["parked"])
                self.retry(1)
                self.push(0)
                self.assertEqual({"ACCEPTED": COUNT - 1, "DAMAGED": 1}, self.states())

    def test_a_pack_of_one_lost_image(self):
        self.stage(0)
        self.damage("UPDATE tile SET state = 'REJECTED', code = 'quota' WHERE id > 1")
        self.assertEqual(-9, push(KILLED, self.outbox, self.server.url, kill_at="announce:after").returncode)
        self.damage("DELETE FROM blob")
        self.assertEqual(1, self.push(1)["parked"])
        self.assertIn("outbox.damaged", self.retry(1))
        self.assertEqual(0, self.push(0)["accepted"])

    def test_a_damaged_document_is_signed_again(self):
        for number, damage in enumerate(("UPDATE document SET text = '{}'", "DELETE FROM document",
                                         "UPDATE document SET text = replace(text, '\"gsd_mm\":120', '\"gsd_mm\":121')")):
            with self.subTest(damage):
                self.begin(f"outbox-{number}")
                self.stage(0)
                self.damage(damage, "UPDATE batch SET stage = 'parked'", "UPDATE tile SET state = 'PARKED'")
                self.assertIn(f"{COUNT} tiles put into 1 new batch\n", self.retry(0))
                self.push(0)
                self.assertEqual({"ACCEPTED": COUNT}, self.states())

    def test_an_intact_parked_batch_is_unchanged(self):
        self.stage(0)
        self.damage("UPDATE batch SET stage = 'parked'", "UPDATE tile SET state = 'PARKED'")
        self.assertIn("1 batch can be retried now; 0 tiles put into 0 new batches", self.retry(0))
        self.assertEqual(COUNT, self.push(0)["accepted"])

    def test_killed_while_setting_aside_and_taking_apart(self):
        for when in ("before", "after"):
            with self.subTest(when):
                self.begin(f"outbox-{when}")
                self.stage(-9, kill_at="seal:before")
                self.damage("UPDATE tile SET sidecar = 'x' WHERE id = 3")
                self.stage(-9, kill_at=f"set-aside:{when}")
                self.retry(1 if when == "before" else 0)  # which signs what is staged, as stage does
                self.damage("UPDATE blob SET bytes = x'00' WHERE tile = 7")
                self.push(1)
                self.retry(-9, kill_at=f"take-apart:{when}")
                self.retry(1 if when == "before" else 0)
                self.push(0)
                self.assertEqual({"ACCEPTED": COUNT - 2, "DAMAGED": 2}, self.states())
                self.assertIn("staged 2 tiles", self.stage(0))
                self.push(0)
                self.assertEqual([], discrepancies(self.outbox, self.server.service, COUNT))

    def test_a_forged_airframe_does_not_block_other_tiles(self):
        def public(key):
            subprocess.run(["openssl", "pkey", "-in", key, "-pubout", "-out", f"{key}.pub"], check=True)
            return f"{key}.pub"
        root, own = self.folder / "root.json", self.folder / "root.key.pem"
        subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", own], check=True, capture_output=True)
        own.chmod(0o600)
        subprocess.run([NADIR, "keys", "root", "--root-key", own, "--package-signer", public(own), "--tile-signer",
                        f"mini-07={public(self.flight.key)}", "--expires", "2099-01-01", "--out", root], check=True, capture_output=True)
        with sqlite3.connect(self.flight.candidates / "tiles.mbtiles") as database:
            database.execute("UPDATE nadir_candidates SET sidecar = replace(sidecar, 'mini-07', 'mini-99') WHERE tile_column ="
                             " (SELECT min(tile_column) FROM nadir_candidates)")
        output = self.stage(1, "--trust", root)
        self.assertIn(f"staged {COUNT - 1} tiles", output)
        self.assertEqual(COUNT - 1, self.push(0)["accepted"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
