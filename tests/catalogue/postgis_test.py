#!/usr/bin/env python3
"""nadir catalogue with a real PostgreSQL + PostGIS server, which this test starts in a folder of its own: a Unix socket,
no network, an unprivileged user, stopped at the end. Judges: psql and ogrinfo.
"""
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
import unittest
from unittest import mock

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "e2e"), str(HERE.parent / "support")]
from postgres import BINARIES, Server  # noqa: E402
from support import AT, NADIR, EndToEnd  # noqa: E402

LAYERS = {"packages": "Multi Polygon", "sources": "Multi Polygon", "sectors": "Polygon", "routes": "Line String",
          "corridors": "Polygon", "required_tiles": "Polygon", "tiles": "Polygon", "gaps": "Multi Polygon"}


class PostGis(EndToEnd):
    @classmethod
    def setUpClass(cls):
        cls.server = Server()
        cls.addClassCleanup(cls.server.remove)
        cls.server.start()
        cls.psql_in("postgres", "CREATE ROLE guest LOGIN PASSWORD 'right'")
        cls.psql_in("postgres", "CREATE DATABASE pattern")
        cls.psql_in("pattern", "CREATE EXTENSION postgis")
        # Packages once for all tests: two of one series, one of another.
        maker = cls("setUp")
        maker.folder = pathlib.Path(tempfile.mkdtemp(prefix="nadir-pg-packages."))
        cls.addClassCleanup(shutil.rmtree, maker.folder, True)
        cls.made = maker.folder
        maker.keys()
        cls.first, cls.second = maker.build("first"), maker.build("second", sequence=2)
        cls.other = maker.build("other", change=lambda text: text.replace("series: small", "series: other"))

    def setUp(self):
        super().setUp()
        self.database = "db" + self.id().rsplit(".", 1)[-1].lower()
        self.psql_in("postgres", f"CREATE DATABASE {self.database} TEMPLATE pattern")
        self.there = f"PG:dbname={self.database}"

    @classmethod
    def psql_in(cls, database, sql):
        return cls.server.psql(database, sql)

    def psql(self, sql):
        return self.psql_in(self.database, sql)

    def nadir(self, *args, code=0, mentions=()):
        result = subprocess.run([NADIR, "catalogue", *map(str, args)], env=self.server.env, text=True,
                                stdin=subprocess.DEVNULL, capture_output=True, timeout=200)
        self.assertEqual(code, result.returncode, f"{args}\n{result.stdout}\n{result.stderr}")
        for word in mentions:
            self.assertIn(word, result.stderr if code == 2 else result.stdout)
        return result

    def starts(self, *args):
        return subprocess.Popen([NADIR, "catalogue", *map(str, args)], env=self.server.env, text=True,
                                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def waits_for_lock(self, count=1):
        """Until so many sessions of this database wait for a lock."""
        for _ in range(1200):
            if int(self.psql("SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND "
                             "wait_event_type = 'Lock'")) >= count:
                return
            time.sleep(0.05)
        self.fail("nobody waits for a lock")

    def holding(self, table):
        """A session that keeps a table to itself until it is ended."""
        session = subprocess.Popen([str(BINARIES / "psql"), "-X", "-q", "-At", "-d", self.database], env=self.server.env,
                                   text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.addCleanup(lambda: (session.kill(), session.communicate()))
        session.stdin.write(f"BEGIN; LOCK TABLE {table} IN ACCESS EXCLUSIVE MODE; SELECT 'held';\n")
        session.stdin.flush()
        self.assertEqual("held\n", session.stdout.readline())
        return session

    def test_layers(self):
        self.nadir("add", self.first, "--to", self.there, "--trust", self.made / "root.json", "--at", AT, mentions=["added small 1"])
        listed = subprocess.run(["ogrinfo", "-so", "-al", "-ro", f"{self.there} schemas=nadir"], env=self.server.env,
                                capture_output=True, text=True, check=True).stdout
        parts = {part.split("\n", 1)[0]: part for part in listed.split("Layer name: ")[1:]}
        tiles = self.psql("SELECT count(*) FROM nadir.tiles")
        for layer, geometry in LAYERS.items():
            self.assertIn(f"Geometry: {geometry}\n", parts[layer])
            self.assertIn('ID["EPSG",4326]', parts[layer])
            self.assertEqual("t", self.psql(f"SELECT coalesce(bool_and(ST_IsValid(geom)), true) FROM nadir.{layer}"))
            self.assertEqual("1", self.psql("SELECT count(*) FROM pg_indexes WHERE schemaname = 'nadir' AND "
                                            f"tablename = '{layer}' AND indexdef LIKE '%USING gist%'"))
        self.assertIn(f"Feature Count: {tiles}\n", parts["tiles"])
        self.assertEqual("1", self.psql("SELECT count(*) FROM nadir.tiles WHERE z = 18 AND "
                                        "ST_Contains(geom, ST_SetSRID(ST_MakePoint(8.5001, 47.4001), 4326))"))
        self.assertEqual("t", self.psql("SELECT ST_Covers(s.geom, p.geom) FROM nadir.sources s, nadir.packages p"))
        self.assertEqual("t", self.psql("SELECT signers <> '' FROM nadir.packages"))
        self.assertEqual("2024-06-01 00:00:00+00", self.psql("SET timezone = 'UTC'; SELECT captured_at FROM nadir.sources")
                         .splitlines()[-1])

    def test_the_same_as_in_spatialite(self):
        self.nadir("add", self.first, "--to", self.there)
        self.nadir("add", self.second, "--to", self.there)
        self.psql(f"ALTER DATABASE {self.database} SET timezone = 'Asia/Taipei'")
        file = self.folder / "fleet.sqlite"
        self.nadir("add", self.first, "--to", file)
        self.nadir("add", self.second, "--to", file)
        for command in (["list", "--json"], ["list", "--at", AT], ["gaps", "--mission", self.made / "mission.yaml", "--at", AT]):
            args = [command[0], None, *command[1:]]
            outputs = []
            for place in (self.there, file):
                args[1] = place
                outputs.append(self.nadir(*args).stdout)
            self.assertEqual(*outputs)
        for place, name in ((self.there, "server.gpkg"), (file, "file.gpkg")):
            self.nadir("export", place, "--format", "gpkg", "--out", self.folder / name)
        rows = [subprocess.run(["ogr2ogr", "-f", "CSV", "/vsistdout/", self.folder / name, "-sql", "SELECT series, sequence, provider, captured_at, tiles, "
                                "ST_AsText(geom) FROM source_states ORDER BY 1, 2", "-dialect", "SQLite"], capture_output=True, text=True, check=True).stdout
                for name in ("server.gpkg", "file.gpkg")]
        self.assertEqual(*rows)
        stale = ["--mission", self.made / "mission.yaml", "--at", "2026-11-05", "--store"]
        self.assertEqual(self.nadir("gaps", self.there, *stale, code=1).stdout, self.nadir("gaps", file, *stale, code=1).stdout)
        self.assertNotEqual("0", self.psql("SELECT count(*) FROM nadir.gaps WHERE reason = 'stale imagery'"))

    def test_added_twice_and_removed(self):
        self.nadir("add", self.first, "--to", self.there)
        self.nadir("add", self.first, "--to", self.there, mentions=["already"])
        self.assertEqual("1", self.psql("SELECT count(*) FROM nadir.packages"))
        self.nadir("remove", "small", "1", "--from", self.there)
        for layer in LAYERS:
            self.assertEqual("0", self.psql(f"SELECT count(*) FROM nadir.{layer}"), layer)
        self.nadir("remove", "small' OR '1'='1", "1", "--from", self.there, code=2)

    def test_writers_at_once(self):
        # Into an empty database: they make the tables at once as well. One package is given twice.
        given = (self.first, self.second, self.other, self.first)
        processes = [self.starts("add", package, "--to", self.there) for package in given]
        for process in processes:
            out, err = process.communicate(timeout=200)
            self.assertEqual(0, process.returncode, out + err)
        self.assertEqual("other 1,small 1,small 2", self.psql(
            "SELECT string_agg(series || ' ' || sequence, ',' ORDER BY series, sequence) FROM nadir.packages"))
        self.assertEqual("0", self.psql("SELECT count(*) FROM nadir.packages p WHERE tiles <> "
                                        "(SELECT count(*) FROM nadir.tiles t WHERE t.package_id = p.id)"))

    def test_a_lost_server(self):
        self.nadir("add", self.first, "--to", self.there)
        self.holding("nadir.tiles")
        process = self.starts("add", self.second, "--to", self.there)
        self.waits_for_lock()  # in its transaction, most of the package written
        self.server.stop()
        try:
            out, err = process.communicate(timeout=200)
        finally:
            self.server.start()
        self.assertEqual(2, process.returncode, out + err)
        self.assertIn("to do:", err)
        self.assertEqual("1", self.psql("SELECT count(*) FROM nadir.packages"))
        self.assertEqual("0", self.psql("SELECT count(*) FROM nadir.sectors WHERE package_id <> "
                                        "(SELECT id FROM nadir.packages)"))
        self.nadir("add", self.second, "--to", self.there, mentions=["added"])

    def test_a_terminated_session(self):
        self.nadir("add", self.first, "--to", self.there)
        self.holding("nadir.tiles")
        process = self.starts("add", self.second, "--to", self.there)
        self.waits_for_lock()
        self.psql("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE wait_event_type = 'Lock' AND "
                  "datname = current_database()")
        out, err = process.communicate(timeout=200)
        self.assertEqual(2, process.returncode, out + err)
        self.assertIn("nothing was written", err)
        self.assertEqual("1", self.psql("SELECT count(*) FROM nadir.packages"))

    def test_wrong_password(self):
        there = f"{self.there} user=guest"
        with mock.patch.dict(self.server.env, PGPASSWORD="falsch"):
            for command in (["list", there], ["add", self.first, "--to", there]):
                talk = self.nadir(*command, code=2, mentions=["PGPASSWORD"]).stderr
                self.assertNotIn("falsch", talk)
        talk = self.nadir("list", f"{there} password=falsch", code=2, mentions=["command line", "password=***", ".pgpass"]).stderr
        self.assertNotIn("falsch", talk)

    def test_no_rights(self):
        self.nadir("add", self.first, "--to", self.there)
        there = f"{self.there} user=guest"
        guest = mock.patch.dict(self.server.env, PGPASSWORD="right")
        with guest:
            self.nadir("add", self.second, "--to", there, code=2, mentions=["to do:"])
            self.nadir("list", there, code=2)
        self.psql("GRANT USAGE ON SCHEMA nadir TO guest; GRANT SELECT ON ALL TABLES IN SCHEMA nadir TO guest")
        with guest:
            self.nadir("list", there, mentions=["small 1"])
            self.nadir("add", self.second, "--to", there, code=2, mentions=["permission denied", "INSERT"])
        self.assertEqual("1", self.psql("SELECT count(*) FROM nadir.packages"))

    def test_no_postgis(self):
        self.psql_in("postgres", "CREATE DATABASE bare TEMPLATE template0")
        for command in (["add", self.first, "--to", "PG:dbname=bare"], ["list", "PG:dbname=bare"]):
            self.nadir(*command, code=2, mentions=["CREATE EXTENSION postgis"])
        self.assertEqual("0", self.psql_in("bare", "SELECT count(*) FROM pg_namespace WHERE nspname = 'nadir'"))

    def test_read_only(self):
        self.nadir("add", self.first, "--to", self.there)
        self.psql(f"ALTER DATABASE {self.database} SET default_transaction_read_only = on")
        self.nadir("add", self.second, "--to", self.there, code=2, mentions=["read-only"])
        self.nadir("remove", "small", "1", "--from", self.there, code=2, mentions=["read-only"])
        self.nadir("list", self.there, mentions=["small 1"])

    def test_nothing_there(self):
        self.nadir("list", self.there, code=2, mentions=["no catalogue"])
        self.nadir("gaps", self.there, "--mission", self.made / "mission.yaml", code=2)
        self.assertEqual("0", self.psql("SELECT count(*) FROM pg_namespace WHERE nspname = 'nadir'"))
        self.nadir("list", "PG:dbname=nowhere", code=2, mentions=["nowhere", "createdb"])
        self.nadir("list", f"PG:dbname=fleet host={self.folder}", code=2, mentions=["start the server"])
        # Somebody else's schema of the same name is left alone.
        self.psql("CREATE SCHEMA nadir; CREATE TABLE nadir.tiles (mine text)")
        self.nadir("add", self.first, "--to", self.there, code=2)
        self.assertEqual("tiles", self.psql("SELECT string_agg(tablename, ',') FROM pg_tables WHERE schemaname = 'nadir'"))


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]], verbosity=2)
