#!/usr/bin/env python3
"""Does the service keep to schemas/nadird.openapi.yaml? Schemathesis makes requests from the contract, right ones and
wrong ones, and checks every answer against it.

usage: contract_test.py TEST_API_SERVER PROJECT_ROOT
Exit code 77: there is no schemathesis in this Python.
"""
import http.client
import importlib.util
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from scripted_service import ScriptedService  # noqa: E402

SERVER, ROOT = sys.argv[1], pathlib.Path(sys.argv[2])
TOKEN = "a-secret-of-the-crew"
CONTRACT = ROOT / "schemas" / "nadird.openapi.yaml"
# 422 is an answer to a right question: its reason stands in the contract.
SETTINGS = """
[checks.positive_data_acceptance]
expected-statuses = ["2xx", "401", "403", "404", "409", "422", "429"]
"""


class Contract(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        token = pathlib.Path(folder.name) / "token"
        token.touch(0o600)
        token.write_text(TOKEN + "\n")
        self.service = ScriptedService(SERVER, "--hint-token-file", token)
        self.addCleanup(self.service.stop)

    def test_no_violation(self):
        with tempfile.TemporaryDirectory() as folder:
            settings = pathlib.Path(folder) / "schemathesis.toml"
            settings.write_text(SETTINGS)
            # An event stream never ends: event streams have tests of their own.
            result = subprocess.run(
                [sys.executable, "-m", "schemathesis.cli", "--config-file", settings, "run", CONTRACT, "--url", self.service.url,
                 "--header", f"Authorization: Bearer {TOKEN}", "--exclude-path", "/v1/events", "--max-examples", "60", "--seed", "1", "--generation-database", "none",
                 "--phases", "examples,coverage,fuzzing", "--no-color"],
                cwd=folder, capture_output=True, text=True, stdin=subprocess.DEVNULL)
        self.assertEqual(0, result.returncode, result.stdout + result.stderr)
        print(result.stdout[-900:])

    def test_events_match_the_contract(self):
        """The stream by hand: each state and event against its schema."""
        import jsonschema_rs
        import yaml
        contract = yaml.safe_load(CONTRACT.read_text())
        schema = lambda name: jsonschema_rs.validator_for({"$ref": f"#/components/schemas/{name}", "components": contract["components"]})
        validators = {"state": schema("State"), "log": schema("Event")}
        connection = http.client.HTTPConnection("127.0.0.1", self.service.port, timeout=60)
        connection.request("GET", "/v1/events")
        response = connection.getresponse()
        self.assertEqual("text/event-stream", response.getheader("Content-Type"))
        seen, kind = {"state": 0, "log": 0}, None
        while min(seen.values()) < 3:
            line = response.readline().decode()
            if line.startswith("event: "):
                kind = line[7:].strip()
            if line.startswith("data: "):
                validators[kind].validate(json.loads(line[6:]))
                seen[kind] += 1
        connection.close()


if __name__ == "__main__":
    if not importlib.util.find_spec("schemathesis"):
        print("SKIPPED: this Python has no schemathesis; see .ci/python-requirements.txt", file=sys.stderr)
        sys.exit(77)
    unittest.main(argv=[sys.argv[0]], verbosity=2)
