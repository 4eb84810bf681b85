#!/usr/bin/env python3
"""Several workers judge the tiles of one catalogue in a real PostGIS server: however many there are, and whatever happens to
them, every tile gets the verdict, and every address the promotion, that one undisturbed worker gives.

usage: workers_test.py NADIR_CANDIDATES MAKE_FLIGHTS
Exit code 77 where there is no PostgreSQL with PostGIS.
"""
import hashlib
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "support")]
from ground_station import Service, Station, flights_in  # noqa: E402
from postgres import BINARIES, Server  # noqa: E402

PROGRAM, MAKE = sys.argv[1:3]
TEMPORARY = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
FLIGHTS, TILES = 3, 300  # three claims
# Who sent what, what became of it, and why; without the ids and times of a run.
DECISIONS = """
SELECT string_agg(line, E'\\n' ORDER BY line) FROM (
  SELECT concat_ws(' ', 'tile', t.sha256, t.z, t.x, t.y, v.verdict, v.code, v.detail, v.contrast_ppm, v.sharpness_ppm, v.to_vote)
    AS line FROM nadir_candidates.tiles t LEFT JOIN nadir_candidates.verdicts v ON v.tile = t.id
  UNION ALL SELECT concat_ws(' ', 'vote', a.sha256, b.sha256, w.shift_mm, w.allowed_mm, w.correlation_ppm, w.agrees)
    FROM nadir_candidates.votes w JOIN nadir_candidates.tiles a ON a.id = w.tile JOIN nadir_candidates.tiles b ON b.id = w.other
  UNION ALL SELECT concat_ws(' ', 'promotion', t.sha256, p.z, p.x, p.y, p.flights, p.evidence, p.current)
    FROM nadir_candidates.promotions p JOIN nadir_candidates.tiles t ON t.id = p.tile
  UNION ALL SELECT concat_ws(' ', 'upload', flight, state) FROM nadir_candidates.uploads) AS lines"""
CLAIMING = """SELECT pid FROM pg_stat_activity WHERE datname = '{}' AND state = 'idle in transaction'
              AND pid IN (SELECT pid FROM pg_locks WHERE mode = 'RowShareLock')"""


IMPATIENT = "-c idle_in_transaction_session_timeout=1500"
# … and whose worker does not take an answer.
ANSWERING = """SELECT pid FROM pg_stat_activity WHERE datname = '{}' AND state = 'active' AND wait_event = 'ClientWrite'
               AND pid IN (SELECT pid FROM pg_locks WHERE mode = 'RowShareLock')"""


ALL_DECIDED = """SELECT 1 WHERE NOT EXISTS (SELECT 1 FROM nadir_candidates.tiles t WHERE NOT EXISTS
                 (SELECT 1 FROM nadir_candidates.verdicts v WHERE v.tile = t.id))"""


class Workers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        """All flights sent and complete, and nothing judged: what each test begins with."""
        cls.base = pathlib.Path(tempfile.mkdtemp(prefix="nadir-workers.", dir=TEMPORARY))
        cls.addClassCleanup(shutil.rmtree, cls.base, True)
        cls.made = cls.base / "made"
        subprocess.run([MAKE, cls.made, str(FLIGHTS), str(TILES)], check=True)
        cls.server = Server()
        cls.addClassCleanup(cls.server.remove)
        cls.server.start()
        cls.server.psql("postgres", "CREATE DATABASE sent")
        cls.server.psql("sent", "CREATE EXTENSION postgis")
        service = Service(PROGRAM, cls.made, cls.base / "data", "--catalogue", "PG:dbname=sent", "--workers", "0", env=cls.server.env)
        service.start()
        station = Station(service, cls.made)
        for flight in flights_in(cls.made):
            station.upload(flight)
        station.close()
        service.stop()
        cls.expected, cls.exported = cls.undisturbed()

    @classmethod
    def undisturbed(cls):
        cls.copy("alone")
        worker = cls.worker("alone", "--until-done")
        _, errors = worker.communicate()
        assert worker.returncode == 0, errors
        return cls.decisions("alone"), cls.export("alone")

    @classmethod
    def copy(cls, name):
        cls.server.psql("postgres", f"CREATE DATABASE {name} TEMPLATE sent")
        shutil.copytree(cls.base / "data", cls.base / name)

    @classmethod
    def worker(cls, name, *options, **environment):
        return subprocess.Popen([PROGRAM, "work", "--data", cls.base / name, "--catalogue", f"PG:dbname={name}", "--quiet", *options],
                                env={**cls.server.env, **environment}, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True)

    @classmethod
    def decisions(cls, name):
        return cls.server.psql(name, DECISIONS).splitlines()

    @classmethod
    def export(cls, name):
        """What becomes of the promoted tiles: the digest of each file of the export."""
        out = cls.base / f"{name}-promoted"
        subprocess.run([PROGRAM, "export", "--data", cls.base / name, "--catalogue", f"PG:dbname={name}", "--out", out],
                       env=cls.server.env, check=True, capture_output=True)
        return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in out.iterdir()}

    def setUp(self):
        self.name = self.id().rsplit(".", 1)[-1].lower()[:40]
        self.copy(self.name)
        self.started = []
        self.addCleanup(self.end_all)

    def start(self, *options, **environment):
        self.started.append(self.worker(self.name, *options, **environment))
        return self.started[-1]

    def end_all(self):
        for worker in self.started:
            if worker.poll() is None:
                worker.send_signal(signal.SIGCONT)
                worker.kill()
            worker.wait()
            for stream in filter(None, (worker.stdin, worker.stdout, worker.stderr)):
                stream.close()

    def finish(self, export=False, **environment):
        """One more worker does what is left; then nothing is lost, and nothing is there twice."""
        last = self.start("--until-done", "--json", **environment)
        output, errors = last.communicate(timeout=120)
        self.assertEqual(0, last.returncode, errors)
        self.assertEqual(self.expected, self.decisions(self.name))
        if export:
            self.assertEqual(self.exported, self.export(self.name))
        return json.loads(output)

    def psql(self, sql):
        return self.server.psql(self.name, sql)

    def claiming(self):
        """A session that holds addresses while its worker looks at their images; None once everything is decided."""
        while not self.psql(ALL_DECIDED):
            if found := self.psql(CLAIMING.format(self.name)):
                return found.splitlines()[0]
        return None

    def test_the_undisturbed_worker_promotes(self):
        kinds = [line.split()[0] for line in self.expected]
        self.assertEqual(FLIGHTS * TILES, kinds.count("tile"))
        self.assertEqual(TILES, kinds.count("promotion"))
        self.assertEqual(TILES * FLIGHTS * (FLIGHTS - 1) // 2, kinds.count("vote"))
        self.assertEqual({"2"}, {line.split()[-1] for line in self.expected if line.startswith("upload")})

    def test_their_number_decides_nothing(self):
        workers = [self.start("--until-done", "--json", "--workers", "2"), self.start("--until-done", "--json")]
        done = []
        for worker in workers:
            output, errors = worker.communicate(timeout=120)
            self.assertEqual(0, worker.returncode, errors)
            done.append(json.loads(output))
        self.assertEqual(FLIGHTS * TILES, sum(one["tiles"] for one in done), "each tile by one of them")
        self.finish(export=True)

    def test_the_services_own_workers_and_others_share_the_work(self):
        service = Service(PROGRAM, self.made, self.base / self.name, "--catalogue", f"PG:dbname={self.name}", "--workers", "2",
                          env=self.server.env)
        service.start()
        self.addCleanup(service.stop)
        self.start("--until-done").wait(timeout=120)
        self.finish()

    def test_killed_at_any_moment(self):
        dice = random.Random(22)
        workers = [self.start() for _ in range(3)]
        for kill in range(12):
            if kill % 3 == 0:
                self.claiming()
            time.sleep(dice.random() * 0.1)
            at = dice.randrange(len(workers))
            workers[at].kill()
            workers[at].wait()
            workers[at] = self.start()
        for worker in workers:
            worker.kill()
            worker.wait()
        self.finish(export=True)

    def test_killed_while_it_holds_addresses(self):
        worker = self.start()
        self.claiming()
        worker.kill()
        worker.wait()
        self.finish()

    def test_one_that_hangs_loses_its_addresses(self):
        """The server ends a session that is silent for too long; the worker that wakes then begins anew, and does no harm."""
        hanging = self.start(PGOPTIONS=IMPATIENT)
        session = self.claiming()
        hanging.send_signal(signal.SIGSTOP)
        self.finish(PGOPTIONS=IMPATIENT)
        self.assertEqual("", self.psql(f"SELECT pid FROM pg_stat_activity WHERE pid = {session}"))
        hanging.send_signal(signal.SIGCONT)
        hanging.send_signal(signal.SIGTERM)
        _, errors = hanging.communicate(timeout=60)
        self.assertEqual(0, hanging.returncode, errors)
        self.assertEqual(self.expected, self.decisions(self.name))

    def test_one_that_hangs_in_the_middle_of_an_answer_loses_them_too(self):
        """Its session is not idle: the server waits until the answer is taken."""
        hanging = self.start(PGOPTIONS=IMPATIENT)
        while not self.psql(ALL_DECIDED):  # stop it where the answer fills the socket
            hanging.send_signal(signal.SIGSTOP)
            time.sleep(0.05)
            if self.psql(ANSWERING.format(self.name)):
                break
            hanging.send_signal(signal.SIGCONT)
            time.sleep(0.003)
        else:
            print("NOT TESTED: no worker was stopped in the middle of an answer", flush=True)
            self.skipTest("no worker was stopped in the middle of an answer")
        self.finish(PGOPTIONS=IMPATIENT)
        self.assertEqual("", self.psql(ANSWERING.format(self.name)))
        hanging.send_signal(signal.SIGCONT)
        hanging.send_signal(signal.SIGTERM)
        _, errors = hanging.communicate(timeout=60)
        self.assertEqual(0, hanging.returncode, errors)
        self.assertEqual(self.expected, self.decisions(self.name))

    def test_one_that_hangs_in_the_middle_of_its_rows_loses_them_too(self):
        """Its session is not idle either: the server waits for the rest of a COPY."""
        hanging = subprocess.Popen([BINARIES / "psql", "-X", "-v", "ON_ERROR_STOP=1", "-d", self.name], env=self.server.env, text=True,
                                   stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.started.append(hanging)
        hanging.stdin.write("BEGIN; SELECT 1 FROM nadir_candidates.addresses LIMIT 5 FOR UPDATE; COPY nadir_candidates.revoked_keys FROM STDIN;\n")
        hanging.stdin.flush()
        sending = f"SELECT pid FROM pg_stat_activity WHERE datname = '{self.name}' AND state = 'active' AND wait_event = 'ClientRead'"
        while not self.psql(sending):
            self.assertIsNone(hanging.poll())
        self.finish(PGOPTIONS=IMPATIENT)
        self.assertEqual("", self.psql(sending))

    def test_a_slow_one_is_not_taken_for_one_that_hangs(self):
        """The limit is shorter than what a claim takes: it writes what it has, and claims the rest again."""
        self.finish(PGOPTIONS="-c idle_in_transaction_session_timeout=300")

    def test_connections_that_are_lost(self):
        workers = [self.start(), self.start()]
        for _ in range(3):
            if session := self.claiming():
                self.psql(f"SELECT pg_terminate_backend({session})")
        for worker in workers:
            self.assertIsNone(worker.poll(), "it connects again")
        self.finish()

    def test_a_server_that_crashes(self):
        worker = self.start()
        self.claiming()
        self.server.stop()
        time.sleep(0.5)
        self.assertIsNone(worker.poll(), "it waits for the server")
        self.server.start()
        self.finish()
        worker.send_signal(signal.SIGTERM)
        self.assertEqual(0, worker.wait(timeout=60))

    def test_rules_are_the_services(self):
        record = self.base / self.name / "started.json"
        started = json.loads(record.read_text())
        record.write_text(json.dumps({**started, "base_packages": 1, "packages": ["ab" * 32]}))
        worker = self.start()
        self.assertIn("the base packages are not the service's", worker.communicate(timeout=60)[1])
        self.assertEqual(2, worker.returncode)
        record.write_text(json.dumps(started))
        worker = self.start()
        self.claiming()
        record.write_text(json.dumps({**started, "votes": 3}))
        self.assertIn("by other rules", worker.communicate(timeout=60)[1])
        self.assertEqual(1, worker.returncode)

    def test_a_file_has_no_other_workers(self):
        for command in (["work", "--data", self.base / self.name],
                        ["serve", "--data", self.base / "file", "--trust", self.made / "root.json", "--token-file",
                         self.made / "ground-1.token", "--workers", "0"]):
            result = subprocess.run([PROGRAM, *command], capture_output=True, text=True, check=False)
            self.assertEqual(2, result.returncode)
            self.assertIn("needs a catalogue in PostGIS", result.stderr)

    def test_a_folder_without_a_service(self):
        result = subprocess.run([PROGRAM, "work", "--data", self.base / "nowhere", "--catalogue", f"PG:dbname={self.name}"],
                                env=self.server.env, capture_output=True, text=True, check=False)
        self.assertEqual(2, result.returncode)
        self.assertIn("no service was started with this folder", result.stderr)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=2)
