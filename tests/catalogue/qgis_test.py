#!/usr/bin/env python3
"""nadir catalogue project with the real QGIS (3.22 or newer), without a screen: it opens the project, all layers are valid,
rules and labels say what is there, and the map is drawn. PostGIS too where there is a server. NADIR_QGIS_PYTHON: the Python that has QGIS's bindings;
NADIR_KEEP: a folder for the pictures.

usage: qgis_test.py NADIR NADIRD NADIR_CANDIDATES MAKE_FLIGHTS
"""
import datetime
import json
import os
import pathlib
import shutil
import subprocess
import sys
import unittest

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "e2e"), str(HERE.parent / "support"), str(HERE.parent / "candidates")]
from ground_station import Service, flights_in, settled  # noqa: E402
from support import NADIR, EndToEnd  # noqa: E402

PROGRAM, MAKE = sys.argv[3:5]
ALWAYS = {"Gaps", "Routes", "Sectors", "Corridors", "Packages", "Earlier versions", "Coverage by age", "Tiles by age"}


def qgis_python():
    for python in filter(None, (os.environ.get("NADIR_QGIS_PYTHON"), "/usr/bin/python3", "python3")):
        if shutil.which(python) and subprocess.run([python, "-c", "import qgis.core"], capture_output=True).returncode == 0:
            return python
    print("NOT TESTED: no Python with QGIS's bindings here (Debian: python3-qgis and qgis-providers)", file=sys.stderr)
    sys.exit(77)


PYTHON = qgis_python()


class Qgis(EndToEnd):
    def opened(self, project, env=None):
        picture = self.folder / (project.stem + ".png")
        result = subprocess.run([PYTHON, HERE / "qgis_project.py", project, picture], capture_output=True, text=True, timeout=240,
                                env={**os.environ, "QT_QPA_PLATFORM": "offscreen", "HOME": str(self.folder),
                                     "XDG_RUNTIME_DIR": str(self.folder), **(env or {})})
        self.assertEqual(0, result.returncode, result.stdout + result.stderr)
        if os.environ.get("NADIR_KEEP"):
            shutil.copy(picture, os.environ["NADIR_KEEP"])
        found = json.loads(result.stdout.splitlines()[-1])
        self.assertTrue(found["loaded"])
        self.assertEqual("EPSG:3857", found["crs"])
        for name, layer in found["layers"].items():
            self.assertTrue(layer["valid"], f"{name}: {layer}")
            self.assertEqual("EPSG:4326", layer["crs"])
            self.assertFalse([text for text in layer["texts"] if text.startswith("error") or text in ("NULL", "None")], f"{name}: {layer}")
        self.assertEqual([], found["errors"])
        return found

    def catalogue(self, where, env=None):
        """Two sequences of a series, and the gaps of a planned mission of which half is beyond the imagery."""
        self.keys()
        for sequence in (1, 2):
            self.good("catalogue", "add", self.build(f"p{sequence}", sequence=sequence), "--to", where)
        planned = self.mission("planned.yaml", 1, lambda text: text.replace("id: small", "id: planned").replace("8.5010, 47.4000]]", "8.5060, 47.4000]]"))
        self.assertEqual(1, subprocess.run([NADIR, "catalogue", "gaps", where, "--mission", planned, "--at", "2024-11-05", "--store"],
                                           capture_output=True).returncode)

    def check_layers(self, found):
        layers = found["layers"]
        self.assertEqual(1, layers["Packages"]["features"], "current ones alone")
        self.assertEqual(["small 2"], layers["Packages"]["texts"])
        self.assertEqual({"valid": 0, "expired": 1}, layers["Packages"]["rules"], "valid until 2024-11-30")
        self.assertEqual(["small 1"], layers["Earlier versions"]["texts"])
        self.assertFalse(layers["Earlier versions"]["shown"])
        age_days = (datetime.datetime.now() - datetime.datetime(2024, 6, 1)).days
        self.assertEqual({"up to 90 days": 0, "up to a year": 0, "up to three years": int(age_days <= 1095), "older": int(age_days > 1095)},
                         layers["Coverage by age"]["rules"])
        self.assertTrue(any(text.startswith("planned: no imagery") for text in layers["Gaps"]["texts"]), layers["Gaps"])
        self.assertGreater(layers["Gaps"]["rules"]["no imagery"], 0)
        for name in ALWAYS:
            self.assertTrue({"series", "sequence", "current"} <= set(layers[name]["fields"]), layers[name])
            self.assertGreater(layers[name]["features"], 0, name)
            # Each feature meets one rule: nothing is left out, nothing drawn twice.
            self.assertEqual(layers[name]["features"], sum(layers[name]["rules"].values()), layers[name])
        self.assertGreater(found["painted"], 0.2)
        self.assertGreater(found["colours"], 20)

    def test_spatialite_with_candidates(self):
        fleet, data, made = self.folder / "it's a fleet.sqlite", self.folder / "service", self.folder / "made"
        self.catalogue(fleet)
        subprocess.run([MAKE, made, "2", "12"], check=True)
        service = Service(PROGRAM, made, data)
        self.addCleanup(service.stop)
        service.start()
        for flight in flights_in(made):
            self.good("sync", "stage", flight / "candidates", "--outbox", self.folder / flight.name, "--key", flight / "tile.key.pem",
                      "--trust", made / "root.json")
            self.good("sync", "push", self.folder / flight.name, "--to", f"http://localhost:{service.port}", "--token-file", made / "ground-1.token")
        settled(PROGRAM, data)
        self.assertEqual(0, service.stop())
        project = self.folder / "maps" / "fleet.qgs"
        project.parent.mkdir()
        self.good("catalogue", "project", fleet, "--candidates", data / "catalogue.sqlite", "--store-styles", "--out", project)
        found = self.opened(project)
        self.assertEqual(ALWAYS | {"Promoted tiles", "Candidate tiles"}, set(found["layers"]))
        self.check_layers(found)
        self.assertEqual({"accepted": 24, "announced": 0, "duplicate": 0, "rejected": 0}, found["layers"]["Candidate tiles"]["rules"])
        self.assertEqual({"promoted": 12}, found["layers"]["Promoted tiles"]["rules"])
        # The folder goes to another place as a whole.
        self.folder.joinpath("moved").mkdir()
        for part in (fleet, data, project.parent):
            shutil.move(part, self.folder / "moved")
        self.assertEqual(1, self.opened(self.folder / "moved" / "maps" / "fleet.qgs")["layers"]["Packages"]["features"])

    def test_an_empty_catalogue(self):
        fleet = self.folder / "fleet.sqlite"
        self.keys()
        self.good("catalogue", "add", self.build(), "--to", fleet)
        self.good("catalogue", "remove", "small", "1", "--from", fleet)
        self.good("catalogue", "project", fleet, "--out", self.folder / "fleet.qgs")
        self.assertEqual({0}, {layer["features"] for layer in self.opened(self.folder / "fleet.qgs")["layers"].values()})

    def test_postgis(self):
        try:
            from postgres import Server
        except SystemExit:
            self.skipTest("NOT TESTED: no PostgreSQL with PostGIS here")
        server = Server()
        self.addCleanup(server.remove)
        server.start()
        server.psql("postgres", "CREATE DATABASE fleet")
        server.psql("fleet", "CREATE EXTENSION postgis")
        old = dict(os.environ)
        self.addCleanup(lambda: (os.environ.clear(), os.environ.update(old)))
        os.environ.update(server.env)
        self.catalogue("PG:dbname=fleet")
        self.good("catalogue", "project", "PG:dbname=fleet", "--store-styles", "--out", self.folder / "fleet-postgis.qgs")
        found = self.opened(self.folder / "fleet-postgis.qgs")
        self.check_layers(found)
        self.assertEqual({name: [True, "QgsRuleBasedRenderer"] for name in found["layers"]},
                         {name: layer["default_style"] for name, layer in found["layers"].items()})
        self.assertEqual("7|7", server.psql("fleet", "SELECT count(*), count(*) FILTER (WHERE useasdefault) FROM layer_styles"))


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]], verbosity=2)
