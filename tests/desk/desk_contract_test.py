#!/usr/bin/env python3
"""Does the desk keep to schemas/desk.openapi.json? Schemathesis makes requests from the contract, right ones and wrong
ones, and checks every answer against it.

usage: desk_contract_test.py NADIR PROJECT_ROOT
Exit code 77: there is no schemathesis in this Python.
"""
import importlib.util
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(sys.argv[2])
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from desk_support import Desk, make_world  # noqa: E402
import support  # noqa: E402

# 422 and 404 are answers to right questions: there is no such flight, package or frame; the reason stands in the answer.
# 413 is one to a text that is too long by far.
SETTINGS = """
[checks.negative_data_rejection]
expected-statuses = ["400", "401", "403", "404", "405", "406", "409", "411", "413", "415", "422", "428", "429"]

[checks.positive_data_acceptance]
expected-statuses = ["2xx", "401", "403", "404", "409", "422", "429"]

# What a schema cannot say: the query describes a single picture, and belongs to no batch.
[[operations]]
include-path = "/v1/flights/{flight}/pictures"
[operations.checks.positive_data_acceptance]
expected-statuses = ["2xx", "400", "404", "422"]

# Likewise: each photo has a file name.
[[operations]]
include-path = "/v1/imports/{import}/files"
[operations.checks.positive_data_acceptance]
expected-statuses = ["2xx", "400", "404"]
"""


class Contract(support.EndToEnd):
    def test_no_violation(self):
        desk = Desk(self.folder / "desk", support.made_once("desk world", make_world)).start()
        self.addCleanup(desk.stop)
        flight = desk.create(package="valley")
        desk.send(flight, desk.frames()[:3])
        desk.settled(flight)
        for i in range(40):  # some of them will be removed
            desk.json("POST", flight + "/objects", {"frame": i % 3, "pixel": {"x": 5 * i, "y": 5 * i}}, 201)
        self.assertEqual(json.loads((ROOT / "schemas" / "desk.openapi.json").read_text()), desk.json("GET", "/v1/openapi.json", expect=200))
        # The flight and the package that are there, so that more than 404 is seen. An event stream never ends.
        contract = json.loads((ROOT / "schemas" / "desk.openapi.json").read_text())
        unfinished = desk.json("POST", "/v1/imports", expect=201)["id"]
        mission = desk.call("POST", "/v1/missions/import?name=mission.yaml", (desk.made / "world" / "mission.yaml").read_bytes(),
                            {"Content-Type": "application/octet-stream"})
        mission = json.loads(mission[2])["mission"]["id"]
        for path, item in contract["paths"].items():
            for parameter in item.get("parameters", []):
                if parameter["name"] == "flight":
                    parameter["schema"] = {"type": "string", "enum": [flight.rsplit("/", 1)[1], "0123456789ab"]}
                if parameter["name"] == "mission":
                    parameter["schema"] = {"type": "string", "enum": [mission, "0123456789ab"]}
                if parameter["name"] == "import":
                    parameter["schema"] = {"type": "string", "enum": [unfinished, "0123456789ab"]}
                if parameter["name"] == "frame":
                    parameter["schema"] = {"type": "integer", "minimum": 0, "maximum": 4}
                if parameter["name"] in ("fix", "object", "sighting"):
                    parameter["schema"]["examples"] = list(range(1, 41))
        with tempfile.TemporaryDirectory() as folder:
            known = pathlib.Path(folder) / "desk.openapi.json"
            known.write_text(json.dumps(contract))
            settings = pathlib.Path(folder) / "schemathesis.toml"
            settings.write_text(SETTINGS)
            result = subprocess.run(
                [sys.executable, "-m", "schemathesis.cli", "--config-file", settings, "run", known, "--url", desk.url, "--exclude-path",
                 "/v1/flights/{flight}/events", "--max-examples", "25", "--seed", "1", "--generation-database", "none", "--phases",
                 "examples,coverage,fuzzing", "--no-color"],
                cwd=folder, capture_output=True, text=True, stdin=subprocess.DEVNULL)
        self.assertEqual(0, result.returncode, result.stdout + result.stderr)
        print(result.stdout[-900:])


if __name__ == "__main__":
    if not importlib.util.find_spec("schemathesis"):
        print("SKIPPED: this Python has no schemathesis; see .ci/python-requirements.txt", file=sys.stderr)
        sys.exit(77)
    unittest.main(argv=[sys.argv[0]], verbosity=2)
