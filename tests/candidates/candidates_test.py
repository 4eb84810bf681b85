#!/usr/bin/env python3
"""nadir-candidates from outside: killed at any moment, in both catalogues, and what it promotes becomes the next map.

usage: candidates_test.py NADIR NADIR_CANDIDATES MAKE_FLIGHTS [postgis]
With postgis everything goes into a real server, which this test starts; exit code 77 where there is none.
"""
import base64
import fcntl
import hashlib
import http.client
import json
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "support")]
from ground_station import Service, Station, flights_in, settled  # noqa: E402

NADIR, PROGRAM, MAKE = sys.argv[1:4]
POSTGIS = "postgis" in sys.argv[4:]
if POSTGIS:
    from postgres import Server

TILES = 60
# In memory where there is such a place: the service syncs with every answer, and kills do not need a disk.
TEMPORARY = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
MISSION = """schema: nadir.mission/1
id: circle
series: circle
sequence: 1
created: {created}
expires: 2035-01-01T00:00:00Z
takeoff: {{lon_deg: {lon}, lat_deg: {lat}}}
terrain: {{mode: flat}}
zoom: {{min: 17, max: 18}}
min_resolution_m: 1.0
budget_mb: 50
freshness_days: {{stable: 730, active: 400}}
airframes: [mini-01]
sectors:
  - {{id: field, class: stable, polygon: [[{w}, {s}], [{e}, {s}], [{e}, {n}], [{w}, {n}], [{w}, {s}]]}}
route: {{corridor_half_width_m: 20, agl_m: 100, points: [[{lon}, {lat}], [{e2}, {lat}]]}}
"""


class Candidates(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.made = pathlib.Path(tempfile.mkdtemp(prefix="nadir-flights.", dir=TEMPORARY))
        cls.addClassCleanup(shutil.rmtree, cls.made, True)
        subprocess.run([MAKE, cls.made, "2", str(TILES)], check=True)
        if POSTGIS:
            cls.server = Server()
            cls.addClassCleanup(cls.server.remove)
            cls.server.start()

    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="nadir-candidates.", dir=TEMPORARY))
        self.addCleanup(shutil.rmtree, self.folder, True)
        self.data = self.folder / "data"
        self.where, self.env = [], None
        if POSTGIS:
            name = "db" + self.id().rsplit(".", 1)[-1].lower()
            self.server.psql("postgres", f"CREATE DATABASE {name}")
            self.server.psql(name, "CREATE EXTENSION postgis")
            self.database = name
            self.where, self.env = ["--catalogue", f"PG:dbname={name}"], self.server.env
        self.service = Service(PROGRAM, self.made, self.data, *self.where, env=self.env)
        self.addCleanup(self.service.stop)
        self.station = Station(self.service, self.made)
        self.addCleanup(lambda: self.station.close())

    def settled(self):
        return settled(PROGRAM, self.data, *self.where, env=self.env)

    def test_flights_become_the_next_map(self):
        self.service.start()
        for flight in flights_in(self.made):
            status = self.station.judged(self.station.upload(flight))
            self.assertEqual({"accepted"}, {tile["verdict"] for tile in status["tiles"]}, status)
        found = self.settled()
        self.assertEqual(TILES, found["tiles"]["promoted"], found)
        self.assertEqual(0, self.service.stop())
        # The circle: promoted tiles are imagery for the next package as they are.
        out = self.folder / "promoted"
        result = subprocess.run([PROGRAM, "export", "--data", self.data, "--out", out, "--json", *self.where], env=self.env,
                                capture_output=True, text=True)
        self.assertEqual(0, result.returncode, result.stderr)
        images = json.loads(result.stdout)["images"]
        self.assertEqual(TILES, sum(image["tiles"] for image in images))
        for image in images:
            info = json.loads(subprocess.run(["gdalinfo", "-json", image["file"]], capture_output=True, check=True).stdout)
            self.assertEqual("COG", info["metadata"]["IMAGE_STRUCTURE"]["LAYOUT"])
            item = json.loads(pathlib.Path(image["file"]).with_suffix(".json").read_text())
            self.assertEqual("Feature", item["type"])
            self.assertAlmostEqual(0.31, item["properties"]["gsd"])
            west, south, east, north = item["bbox"]
            self.assertTrue(west < east and south < north)
        west, south, east, north = self.middle(images)
        created = json.loads(pathlib.Path(images[0]["file"]).with_suffix(".json").read_text())["properties"]["datetime"]
        mission = self.folder / "mission.yaml"
        mission.write_text(MISSION.format(created=created[:10] + "T23:59:59Z", lon=(west + east) / 2, lat=(south + north) / 2,
                                          e2=(west + east) / 2 + (east - west) / 8, w=west, s=south, e=east, n=north))
        result = subprocess.run([NADIR, "cache", "build", "--mission", mission, "--imagery", *[image["file"] for image in images],
                                 "--out", self.folder / "package"], capture_output=True, text=True)
        self.assertEqual(0, result.returncode, result.stdout + result.stderr)

    def middle(self, images):
        """A small area in the middle of the largest image, well within it."""
        largest = max(images, key=lambda image: image["tiles"])
        west, south, east, north = json.loads(pathlib.Path(largest["file"]).with_suffix(".json").read_text())["bbox"]
        x, y = (west + east) / 2, (south + north) / 2
        return x - (east - west) / 8, y - (north - south) / 8, x + (east - west) / 8, y + (north - south) / 8

    def test_the_ground_stations_own_uploader(self):
        """nadir sync at this end: two flights as they leave their aircraft come home, vote, and coming again adds nothing."""
        self.service.start()
        token = ["--token-file", self.made / "ground-1.token"]
        for flight in flights_in(self.made):
            outbox = self.folder / flight.name
            for command in (["stage", flight / "candidates", "--outbox", outbox, "--key", flight / "tile.key.pem", "--trust",
                             self.made / "root.json"],
                            ["push", outbox, "--to", f"http://localhost:{self.service.port}", *token],
                            ["push", outbox, "--to", f"http://localhost:{self.service.port}", *token]):
                result = subprocess.run([NADIR, "sync", *command], capture_output=True, text=True)
                self.assertEqual(0, result.returncode, f"{command} {result.stdout} {result.stderr}")
        found = self.settled()
        self.assertEqual(2, found["uploads"]["all"], found)
        self.assertEqual(2 * TILES, found["tiles"]["accepted"], found)
        self.assertEqual(TILES, found["tiles"]["promoted"], found)
        # The aircraft's reports came with their tiles; the list shows them, without a note.
        result = self.run_program("installed", "--data", self.data, "--json")
        self.assertEqual(0, result.returncode, result.stdout + result.stderr)
        aircraft = json.loads(result.stdout)["aircraft"]
        self.assertEqual([("mini-01", "valley", 3), ("mini-02", "valley", 3)],
                         [(one["airframe"], one["series"], one["sequence"]) for one in aircraft])
        self.assertEqual(["installed.report"] * 2, [line["act"] for line in self.audit() if line["act"].startswith("installed")])

    def run_program(self, *args):
        return subprocess.run([PROGRAM, *args], env=self.env, capture_output=True, text=True)

    def audit(self):
        """The lines of the audit log, whose numbers have no holes."""
        lines = [json.loads(line) for line in (self.data / "audit" / "audit.jsonl").read_text().splitlines()]
        self.assertEqual(list(range(1, len(lines) + 1)), [line["n"] for line in lines])
        return lines

    def test_a_root_put_back_stays_refused_over_a_restart(self):
        """Whoever can write the root's file undoes no revocation, neither in the running service nor by a restart."""
        made = self.service.made = shutil.copytree(self.made, self.folder / "made")
        root = made / "root.json"
        first = root.read_bytes()
        self.service.start()
        self.station.judged(self.station.upload(flights_in(made)[0]))
        lost = json.loads((flights_in(made)[0] / "batch-0.json").read_text())["signatures"][0]["keyid"]
        subprocess.run([NADIR, "keys", "revoke", "--previous", root, "--revoke", lost, "--root-key", made / "root.key.pem",
                        "--out", self.folder / "2.json"], check=True, capture_output=True)
        self.service.kill()
        (self.folder / "2.json").replace(root)
        self.service.start()
        self.assertEqual({"airframe_revoked": TILES}, self.settled()["rejected"])
        self.service.kill()
        root.write_bytes(first)
        self.service.start()
        health = json.loads(self.station.ask("GET", "/v1/health")[2])
        self.assertEqual("warn", health["status"])
        self.assertIn("version 2 stays in force", health["reason"])
        other = json.loads((flights_in(made)[0] / "batch-0.json").read_text())
        self.assertEqual({"airframe_revoked": TILES}, self.settled()["rejected"], other["signed"]["airframe"])
        self.service.stop()
        acts = [(line["act"], line["result"]) for line in self.audit()]
        self.assertIn(("root.trust", "as given"), acts)
        self.assertIn(("tiles.withdraw", "withdrawn"), acts)
        self.assertIn(("root.trust", "rejected"), acts)

    def test_tokens_end_and_are_taken_back(self):
        """The programs' whole way: a token is created, uploads, is taken out of the file, and uploads no more."""
        tokens, secret = self.folder / "tokens.json", self.folder / "station.token"
        result = self.run_program("token", "create", "--tokens", tokens, "--id", "station", "--out", secret, "--days", "1")
        self.assertEqual(0, result.returncode, result.stderr)
        self.assertEqual(0o600, secret.stat().st_mode & 0o777)
        self.assertNotIn(secret.read_text().strip(), tokens.read_text())
        self.assertEqual(2, self.run_program("token", "create", "--tokens", tokens, "--id", "station", "--out",
                                             self.folder / "again.token").returncode, "an id twice")
        self.assertFalse((self.folder / "again.token").exists())
        hangs = os.open(self.folder, os.O_RDONLY)  # as another command that changes the file
        fcntl.flock(hangs, fcntl.LOCK_EX)
        result = self.run_program("token", "revoke", "--tokens", tokens, "--id", "station")
        os.close(hangs)
        self.assertEqual(2, result.returncode, result.stderr)
        self.assertIn("another process has had it locked for too long", result.stderr)
        self.service.options = (*self.service.options, "--tokens", tokens)
        self.service.start()
        flight, outbox = flights_in(self.made)[0], self.folder / "outbox"
        subprocess.run([NADIR, "sync", "stage", flight / "candidates", "--outbox", outbox, "--key", flight / "tile.key.pem"],
                       check=True, capture_output=True)
        push = [NADIR, "sync", "push", outbox, "--to", f"http://localhost:{self.service.port}", "--token-file", secret]
        result = subprocess.run(push, capture_output=True, text=True)
        self.assertEqual(0, result.returncode, result.stderr)
        self.assertEqual("station", json.loads(self.run_program("token", "list", "--tokens", tokens, "--json").stdout)["tokens"][0]["id"])
        self.assertEqual(0, self.run_program("token", "revoke", "--tokens", tokens, "--id", "station").returncode)
        bearer = {"Authorization": f"Bearer {secret.read_text().strip()}"}
        while self.station.ask("GET", "/v1/reason-codes", **bearer)[0] == 200:
            time.sleep(0.05)
        self.assertEqual(401, self.station.ask("GET", "/v1/reason-codes", **bearer)[0])
        self.service.stop()
        lines = self.audit()
        self.assertIn("station", {line.get("token") for line in lines if line["act"] == "batch.announce"})
        self.assertTrue([line for line in lines if line["act"] == "tokens.load"])

    def test_risky_options_are_reported_at_the_start(self):
        """One airframe's key that promotes by itself is the operator's choice: it is reported, and recorded in the audit log."""
        self.service = Service(PROGRAM, self.made, self.data, *self.where, "--independent", "days", env=self.env)
        self.service.start()
        self.service.process.terminate()
        log = self.service.process.stderr.read()
        self.service.process.wait()
        self.service.process.stderr.close()
        for words in ("promotes tiles by itself", "no tile is compared with a map", "do not expire", "is trusted as it is"):
            self.assertIn(words, log)
            self.assertTrue([line for line in self.audit() if words in line.get("detail", "")], words)

    def test_what_is_risky_is_shown_for_as_long_as_it_holds(self):
        """By the service's health and by status, also while nobody has seen the start; and no longer once it is over."""
        risky = "promotes tiles by itself"

        def shown():
            health = json.loads(self.station.ask("GET", "/v1/health")[2])
            self.assertEqual("pass", health["status"], "a choice is no fault")
            status = json.loads(self.run_program("status", "--data", self.data, "--json", *self.where).stdout)
            text = self.run_program("status", "--data", self.data, *self.where).stdout
            found = [any(risky in note for note in notes) for notes in (health["notes"], status["warnings"], [text])]
            self.assertEqual(1, len(set(found)), f"{health} {status} {text}")
            self.assertIn(f"2 flights, independent by {status['rules']['independent']}", text)
            return found[0], status["rules"]["independent"]

        plain = self.service.options
        self.service.options = (*plain, "--independent", "days")
        self.service.start()
        self.assertEqual((True, "days"), shown())
        self.service.kill()
        self.service.options = plain
        self.service.start()
        self.assertEqual((False, "airframes"), shown())
        (self.data / "started.json").write_text('{"schema": "nadir.candidate-start/1", "votes": 1')
        status = self.run_program("status", "--data", self.data, "--json", *self.where)
        self.assertEqual(0, status.returncode, status.stderr)
        self.assertIsNone(json.loads(status.stdout)["rules"])
        self.assertIn("started.json", json.loads(status.stdout)["warnings"][0])

    def test_help_lists_each_command_once(self):
        text = self.run_program("--help").stdout
        for command in ("serve", "status", "export", "installed", "token create", "token list", "token revoke"):
            lines = [line for line in text.splitlines() if line.strip().startswith(command + " ")]
            self.assertEqual(1, len(lines), text)

    def test_an_aircrafts_report_that_goes_back_shows(self):
        self.service.start()
        flight, outbox = flights_in(self.made)[0], self.folder / "outbox"
        subprocess.run([NADIR, "sync", "stage", flight / "candidates", "--outbox", outbox, "--key", flight / "tile.key.pem"],
                       check=True, capture_output=True)
        subprocess.run([NADIR, "sync", "push", outbox, "--to", f"http://localhost:{self.service.port}", "--token-file",
                        self.made / "ground-1.token"], check=True, capture_output=True)
        record = self.data / "installed" / "mini-01.json"
        document = json.loads(record.read_text())
        document["highest_sequence"] = 9
        record.write_text(json.dumps(document))
        result = self.run_program("installed", "--data", self.data)
        self.assertEqual(1, result.returncode, result.stderr)
        self.assertIn("went back from sequence 9", result.stdout)
        record.write_text("{")
        result = self.run_program("installed", "--data", self.data)
        self.assertEqual(1, result.returncode, result.stderr)
        self.assertIn("damaged", result.stdout)
        self.assertEqual(0, self.run_program("installed", "--data", self.data, "--forget", "mini-01").returncode)
        self.assertEqual(2, self.run_program("installed", "--data", self.data, "--forget", "mini-01").returncode)

    def test_a_start_on_a_bad_disk_serves_and_reports(self):
        """A pack's path is blocked: the service starts, accepts other flights, reports the error, and loses nothing."""
        self.service.start()
        upload = self.station.announce(flights_in(self.made)[0] / "batch-0.json")["upload_id"]
        pack = sorted(flights_in(self.made)[0].glob("0-*.pack"))[0]
        self.service.kill()
        digest = hashlib.sha256(pack.read_bytes()).hexdigest()
        incoming = self.data / "incoming" / upload
        incoming.mkdir(parents=True)
        shutil.copy(pack, incoming / f"{digest}.{pack.stat().st_size}")
        (self.data / "packs" / digest[:2]).write_text("in the way")
        self.service.start()
        health = json.loads(self.station.ask("GET", "/v1/health")[2])
        self.assertEqual("warn", health["status"], health)
        self.assertIn("complete packs were not taken in", health["reason"])
        self.station.judged(self.station.upload(flights_in(self.made)[1]))
        self.service.stop()
        (self.data / "packs" / digest[:2]).unlink()
        self.service.start()
        self.assertEqual("pass", json.loads(self.station.ask("GET", "/v1/health")[2])["status"])
        self.assertEqual(200, self.station.ask("HEAD", f"/v1/uploads/{upload}/packs/{digest}")[0])

    def test_revoking_an_airframe_revokes_its_promotions(self):
        """The aircraft was lost and its key with it: nadir keys revoke, and no map is made of what it vouched for."""
        self.service.made = shutil.copytree(self.made, self.folder / "made")
        root = self.service.made / "root.json"
        self.service.start()
        for flight in flights_in(self.made):
            self.station.judged(self.station.upload(flight))
        self.assertEqual(TILES, self.settled()["tiles"]["promoted"])
        self.service.kill()
        lost = json.loads((flights_in(self.made)[0] / "batch-0.json").read_text())["signatures"][0]["keyid"]
        subprocess.run([NADIR, "keys", "revoke", "--previous", root, "--revoke", lost, "--root-key",
                        self.service.made / "root.key.pem", "--out", self.folder / "2.json"], check=True, capture_output=True)
        (self.folder / "2.json").replace(root)
        self.service.start()
        found = self.settled()
        self.assertEqual(0, found["tiles"]["promoted"], found)
        self.assertEqual(TILES, found["tiles"]["accepted"], found)
        self.assertEqual({"airframe_revoked": TILES}, found["rejected"], found)

    def test_reports_that_nothing_is_promoted(self):
        self.service.start()
        self.station.judged(self.station.upload(flights_in(self.made)[0]))
        self.service.stop()
        result = subprocess.run([PROGRAM, "export", "--data", self.data, "--out", self.folder / "promoted", *self.where],
                                env=self.env, capture_output=True, text=True)
        self.assertEqual(1, result.returncode, result.stderr)
        self.assertFalse((self.folder / "promoted").exists())

    def test_killed_at_any_moment(self):
        """kill -9 while it works on calls, by a seed: what was acknowledged is there after each, and nothing comes twice."""
        for seed in (1, 2, 3):
            with self.subTest(seed=seed):
                self.kill_and_go_on(random.Random(seed))
                self.service.stop()
                shutil.rmtree(self.data)
                if POSTGIS:
                    return  # its own crash safety is PostgreSQL's

    def kill_and_go_on(self, dice):
        kills, acknowledged = 0, {}

        def maybe_kill():
            nonlocal kills
            if kills < 10 and dice.random() < 0.4:
                kills += 1
                time.sleep(dice.random() * 0.03)
                self.service.kill()

        def surely(work):
            """Until it is done, each time on a new service when the old one was killed."""
            while True:
                try:
                    return work()
                except (OSError, http.client.HTTPException):
                    self.service.kill()
                    self.service.start()
                    for path, offset in acknowledged.items():
                        status, headers, _ = self.unharmed.ask("HEAD", path)
                        self.assertEqual(200, status, path)
                        self.assertGreaterEqual(int(headers["Upload-Offset"]), offset)

        self.service.start()
        self.unharmed = Station(self.service, self.made)
        self.station = Station(self.service, self.made, before_answer=maybe_kill)
        self.addCleanup(self.unharmed.close)
        self.addCleanup(self.station.close)
        for flight in flights_in(self.made):
            upload = surely(lambda: self.station.announce(flight / "batch-0.json"))["upload_id"]
            for pack in sorted(flight.glob("0-*.pack")):
                surely(lambda: self.station.send(upload, pack, part=300_000, acknowledged=acknowledged))
            surely(lambda: self.station.complete(upload))
            status = surely(lambda: self.station.judged(upload))
            self.assertEqual({"accepted"}, {tile["verdict"] for tile in status["tiles"]})
            self.assertEqual(TILES, len(status["tiles"]))
        if self.service.process.poll() is not None:  # its last answer was on the way when it was killed
            self.service.start()
        found = self.settled()
        self.assertGreater(kills, 5)
        self.assertEqual(2, found["uploads"]["all"], found)
        self.assertEqual(2 * TILES, found["tiles"]["accepted"], found)
        self.assertEqual(0, found["tiles"]["duplicate"] + found["tiles"]["rejected"], found)
        self.assertEqual(TILES, found["tiles"]["promoted"], found)
        self.assertEqual([], [path for path in (self.data / "incoming").rglob("*") if path.is_file()])

    def test_a_damaged_pack_is_sent_again(self):
        """Bytes that rot between upload and verdict: their tile is rejected alone, and the uploader brings it again."""
        flight = flights_in(self.made)[0]
        self.service.start()
        upload = self.station.announce(flight / "batch-0.json")["upload_id"]
        for pack in sorted(flight.glob("0-*.pack")):
            self.station.send(upload, pack)
        self.service.stop()
        kept = sorted(path for path in (self.data / "packs").rglob("*") if path.is_file())
        rotten = bytearray(kept[0].read_bytes())
        rotten[-1] ^= 1
        kept[0].write_bytes(rotten)
        self.service.start()
        self.station.complete(upload)
        rejected = [tile for tile in self.station.judged(upload)["tiles"] if tile["verdict"] != "accepted"]
        self.assertEqual([("rejected", "hash_mismatch", True)],
                         [(tile["verdict"], tile["code"], tile["retryable"]) for tile in rejected])

        outbox = self.folder / "outbox"
        for command in (["stage", flight / "candidates", "--outbox", outbox, "--key", flight / "tile.key.pem", "--trust",
                         self.made / "root.json"],
                        ["push", outbox, "--to", f"http://localhost:{self.service.port}", "--token-file",
                         self.made / "ground-1.token"]):
            result = subprocess.run([NADIR, "sync", *command], capture_output=True, text=True)
            self.assertEqual(0, result.returncode, f"{command} {result.stdout} {result.stderr}")
        found = self.settled()["tiles"]
        self.assertEqual((TILES, TILES - 1, 1), (found["accepted"], found["duplicate"], found["rejected"]), found)

    def test_abandoned_packs_make_room(self):
        self.service.start()
        upload = self.station.announce(flights_in(self.made)[0] / "batch-0.json")["upload_id"]
        part = b"x" * 100
        digest = base64.b64encode(hashlib.sha256(part).digest()).decode()

        def begin(number):
            name = hashlib.sha256(bytes([number])).hexdigest()
            status, headers, _ = self.station.ask(
                "PATCH", f"/v1/uploads/{upload}/packs/{name}", part,
                **{"Content-Type": "application/octet-stream", "Upload-Offset": "0", "Upload-Length": "1000",
                   "Content-Digest": f"sha-256=:{digest}:"})
            return status, headers["Retry-After"]

        for number in range(4):
            self.assertEqual(204, begin(number)[0])
        status, retry_after = begin(4)
        self.assertEqual(429, status)
        self.assertTrue(retry_after)
        for path in (self.data / "incoming" / upload).iterdir():  # as if they had been left five minutes ago
            long_ago = path.stat().st_mtime - 301
            os.utime(path, (long_ago, long_ago))
        self.assertEqual(204, begin(4)[0])
        self.assertEqual(4, len(list((self.data / "incoming" / upload).iterdir())))

    def test_two_services_do_not_share_a_folder(self):
        self.service.start()
        second = Service(PROGRAM, self.made, self.data, *self.where, env=self.env)
        with self.assertRaisesRegex(RuntimeError, "another service"):
            second.start()
        second.kill()

    def test_invalid_options_are_reported(self):
        for options, word in ((["--votes", "1"], "votes"), (["--max-age-days", "x"], "max-age-days"),
                              (["--package", str(self.folder)], "manifest.json"), (["--catalogue", "/vsimem/x"], "catalogue")):
            service = Service(PROGRAM, self.made, self.data, *options, env=self.env)
            with self.assertRaisesRegex(RuntimeError, word):
                service.start()
            self.assertEqual(2, service.process.returncode)
            service.kill()


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]], verbosity=2)
