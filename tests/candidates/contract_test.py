#!/usr/bin/env python3
"""Does nadir-candidates keep to schemas/candidates.openapi.yaml? Schemathesis makes requests from the contract, right ones
and wrong ones, and checks every answer against it; then a real upload, each of whose answers is held against its schema.

usage: contract_test.py NADIR NADIR_CANDIDATES MAKE_FLIGHTS PROJECT_ROOT
Exit code 77: there is no schemathesis in this Python.
"""
import importlib.util
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from ground_station import Service, Station, flights_in  # noqa: E402

_, PROGRAM, MAKE, ROOT = sys.argv[1:5]
CONTRACT = pathlib.Path(ROOT) / "schemas" / "candidates.openapi.yaml"
# 404, 409, 422 and 460 are answers to right questions: their reasons stand in the contract.
SETTINGS = """
[checks.positive_data_acceptance]
expected-statuses = ["2xx", "401", "403", "404", "409", "422", "460"]
[checks.negative_data_rejection]
expected-statuses = ["400", "401", "403", "404", "405", "409", "411", "413", "415", "422", "460"]
"""


class Contract(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="nadir-contract."))
        self.addCleanup(shutil.rmtree, self.folder, True)
        self.made = self.folder / "made"
        subprocess.run([MAKE, self.made, "1", "3"], check=True)
        self.service = Service(PROGRAM, self.made, self.folder / "data")
        self.addCleanup(self.service.stop)
        self.service.start()
        self.station = Station(self.service, self.made)

    def test_no_violation(self):
        settings = self.folder / "schemathesis.toml"
        settings.write_text(SETTINGS)
        result = subprocess.run(
            [sys.executable, "-m", "schemathesis.cli", "--config-file", settings, "run", CONTRACT, "--url",
             f"http://127.0.0.1:{self.service.port}", "--header", f"Authorization: Bearer {self.station.token}",
             "--max-examples", "25", "--seed", "1", "--generation-database", "none", "--phases", "examples,coverage,fuzzing",
             "--no-color"],
            cwd=self.folder, capture_output=True, text=True, stdin=subprocess.DEVNULL)
        self.assertEqual(0, result.returncode, result.stdout + result.stderr)
        print(result.stdout[-900:])

    def test_an_upload_matches_the_contract(self):
        import jsonschema_rs
        import yaml
        contract = yaml.safe_load(CONTRACT.read_text())

        def holds(schema, document):
            jsonschema_rs.validator_for({"$ref": f"#/components/schemas/{schema}", "components": contract["components"]}).validate(document)

        flight = flights_in(self.made)[0]
        holds("Batch", json.loads((flight / "batch-0.json").read_text()))
        announcement = self.station.announce(flight / "batch-0.json")
        holds("Announcement", announcement)
        upload = announcement["upload_id"]
        self.assertEqual(3, len(announcement["missing"]))
        holds("UploadStatus", self.station.status(upload))
        status, _, body = self.station.ask("POST", f"/v1/uploads/{upload}/complete")
        self.assertEqual(409, status)
        holds("IncompleteProblem", json.loads(body))
        for pack in flight.glob("0-*.pack"):
            self.station.send(upload, pack, part=20_000)
        status, _, body = self.station.ask("POST", f"/v1/uploads/{upload}/complete")
        self.assertEqual(202, status)
        holds("Completion", json.loads(body))
        judged = self.station.judged(upload)
        holds("UploadStatus", judged)
        self.assertEqual({"accepted"}, {tile["verdict"] for tile in judged["tiles"]})
        holds("ReasonCodes", json.loads(self.station.ask("GET", "/v1/reason-codes")[2]))
        holds("Health", json.loads(self.station.ask("GET", "/v1/health")[2]))
        report = (flight / "candidates" / "installed.json").read_bytes()
        holds("InstalledReport", json.loads(report))
        for expected in (201, 200):
            status, _, body = self.station.ask("POST", "/v1/installed", report, **{"Content-Type": "application/json"})
            self.assertEqual(expected, status, body)
            holds("InstalledResult", json.loads(body))
        listed = json.loads(self.station.ask("GET", "/v1/installed")[2])
        holds("InstalledList", listed)
        self.assertEqual("mini-01", listed["aircraft"][0]["airframe"])

    def test_files_are_what_their_schemas_say(self):
        import jsonschema_rs

        def takes(schema, document):
            text = (pathlib.Path(ROOT) / "schemas" / f"{schema}.schema.json").read_text()
            return jsonschema_rs.validator_for(json.loads(text)).is_valid(document)

        report = json.loads((flights_in(self.made)[0] / "candidates" / "installed.json").read_text())
        self.assertTrue(takes("installed", report))
        report["signed"]["airframe"] = "../x"
        self.assertFalse(takes("installed", report))
        tokens = self.folder / "tokens.json"
        for identity, more in (("a", ["--airframe", "mini-01"]), ("b", ["--scope", "both", "--client", "a"])):
            subprocess.run([PROGRAM, "token", "create", "--tokens", tokens, "--id", identity, "--out", self.folder / identity, *more],
                           check=True, capture_output=True)
        document = json.loads(tokens.read_text())
        self.assertTrue(takes("tokens", document))
        document["tokens"][0]["scope"] = []
        self.assertFalse(takes("tokens", document))


if __name__ == "__main__":
    if not importlib.util.find_spec("schemathesis"):
        print("SKIPPED: this Python has no schemathesis; see .ci/python-requirements.txt", file=sys.stderr)
        sys.exit(77)
    unittest.main(argv=[sys.argv[0]], verbosity=2)
