#!/usr/bin/env python3
"""Every request of `nadir sync push`, and every answer of the tests' own server, checked against
schemas/candidates.openapi.yaml: what the tests of the uploader prove, they prove about the contract.

usage: contract_test.py TEST_KILLED_SYNC TEST_MAKE_CANDIDATES PROJECT_ROOT
"""
import json
import pathlib
import re
import sys
import tempfile
import unittest

import jsonschema_rs
import yaml

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from fault_server import FaultServer, Faults  # noqa: E402
from fault_service import Service  # noqa: E402
from support import TEMPORARY, Flight, push, sync  # noqa: E402

KILLED, MAKE, ROOT = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3])
CONTRACT = yaml.safe_load((ROOT / "schemas/candidates.openapi.yaml").read_text())


def resolved(item):
    while "$ref" in item:
        found = CONTRACT
        for step in item["$ref"].removeprefix("#/").split("/"):
            found = found[step]
        item = found
    return item


def judge(schema, value):
    validator = jsonschema_rs.validator_for({"allOf": [schema], "components": CONTRACT["components"]})
    return [f"{error.instance_path}: {error.message}" for error in validator.iter_errors(value)]


def operation_of(method, path):
    for template, item in CONTRACT["paths"].items():
        match = re.fullmatch(re.sub(r"\{(\w+)\}", r"(?P<\1>[^/]+)", template), path)
        if match and method.lower() in item:
            return item[method.lower()], item.get("parameters", []), match.groupdict()
    raise AssertionError(f"{method} {path} is not in the contract")


def header_value(schema, text):
    return int(text) if resolved(schema).get("type") == "integer" else text


def check_request(method, path, headers, body):
    operation, shared, in_path = operation_of(method, path)
    for parameter in map(resolved, shared + operation.get("parameters", [])):
        text = in_path.get(parameter["name"]) if parameter["in"] == "path" else headers.get(parameter["name"])
        if text is None:
            if parameter.get("required"):
                yield f"{method} {path}: no {parameter['name']}"
            continue
        yield from (f"{parameter['name']}: {error}" for error in judge(parameter["schema"], header_value(parameter["schema"], text)))
    content = operation.get("requestBody", {}).get("content", {})
    if "application/json" in content:
        yield from judge(content["application/json"]["schema"], json.loads(body))
    if content and headers.get("Content-Type") not in content:
        yield f"{method} {path}: Content-Type {headers.get('Content-Type')}"


def check_answer(method, path, status, headers, body):
    operation, _, _ = operation_of(method, path)
    if str(status) not in operation["responses"]:
        yield f"{method} {path}: {status} is not in the contract"
        return
    answer = resolved(operation["responses"][str(status)])
    for name, header in answer.get("headers", {}).items():
        header = resolved(header)
        if name in headers:
            yield from judge(header["schema"], header_value(header["schema"], headers[name]))
        elif header.get("required"):
            yield f"{method} {path}: {status} without {name}"
    if method != "HEAD":
        for kind, media in answer.get("content", {}).items():
            if headers.get("Content-Type") != kind:
                yield f"{method} {path}: {status} as {headers.get('Content-Type')}"
            else:
                yield from judge(media["schema"], json.loads(body))


class BothSides(unittest.TestCase):
    def test_every_request_and_answer(self):
        found, seen = [], set()

        def watch(method, path, headers, body, status, answered, reply):
            seen.add((method, status))
            found.extend(check_request(method, path, headers, body))
            found.extend(check_answer(method, path, status, answered, reply))

        service = Service(judge=lambda s: "blurred" if s["x"] % 5 == 0 else None,
                          refuse=lambda s: "too_old" if s["x"] % 7 == 0 else None)
        # Faults that keep to the contract themselves.
        server = FaultServer(service, Faults(4, 0.3, ("busy_429", "lost_reply", "twice", "forget", "mangled"), most=40), watch=watch)
        self.addCleanup(server.stop)
        with tempfile.TemporaryDirectory(dir=TEMPORARY) as folder:
            flight, outbox = Flight(folder, MAKE, 150, 40_000), pathlib.Path(folder) / "outbox"
            sync(KILLED, "stage", flight.candidates, "--outbox", outbox, "--key", flight.key)
            result = push(KILLED, outbox, server.url)
            self.assertIn(result.returncode, (0, 1), result.stderr)
        self.assertEqual([], found[:10])
        self.assertGreaterEqual(seen, {("POST", 201), ("PATCH", 204), ("POST", 202), ("GET", 200)})
        print(sorted(seen))

    def test_the_examples_match_the_schemas(self):
        """OpenAPI's own validators do not look into examples."""
        counted = 0
        for path, item in CONTRACT["paths"].items():
            for method, operation in item.items():
                if method == "parameters":
                    continue
                media = [operation.get("requestBody", {})] + [resolved(r) for r in operation["responses"].values()]
                for kind in (c for m in media for c in resolved(m).get("content", {}).values()):
                    values = [kind["example"]] if "example" in kind else []
                    values += [resolved(example)["value"] for example in kind.get("examples", {}).values()]
                    for value in values:
                        counted += 1
                        self.assertEqual([], judge(kind["schema"], value), f"{method} {path}")
        self.assertGreaterEqual(counted, 8)

    def test_wrong_ones_are_detected(self):
        self.assertTrue(list(check_request("POST", "/v1/uploads", {"Content-Type": "application/json"}, b"{}")))
        self.assertTrue(list(check_answer("GET", "/v1/uploads/upload-01", 200, {"Content-Type": "application/json"}, b"{}")))
        self.assertTrue(list(check_answer("PATCH", "/v1/uploads/upload-01/packs/" + 64 * "a", 204, {}, b"")))
        with self.assertRaises(AssertionError):
            operation_of("DELETE", "/v1/uploads")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
