#!/usr/bin/env python3
"""An independent reading of the contract: openapi-spec-validator checks schemas/candidates.openapi.yaml, and a client
that openapi-python-client generates from it uploads a batch of tiles and fetches the verdicts. The only code here is what
the contract states in prose: how a pack is made.

usage: ./run bench contract [--url URL --token-file FILE --candidates FOLDER --key KEY.pem]
Without --url the tests' own server is the other end; with it a service that trusts the key.
NADIR_BENCH_VENV: a Python virtual environment with openapi-python-client and openapi-spec-validator.
"""
import argparse
import base64
import hashlib
import io
import json
import os
import pathlib
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
CONTRACT = ROOT / "schemas/candidates.openapi.yaml"
sys.path.insert(0, str(ROOT / "tests" / "sync"))
NADIR, MAKE = ROOT / "build/bin/nadir", ROOT / "build/bin/test_make_candidates"


def pack_of(pictures):
    head = b"".join(struct.pack(">32sI", hashlib.sha256(p).digest(), len(p)) for p in pictures)
    return b"NADIRPK1" + struct.pack(">I", len(pictures)) + head + b"".join(pictures)


def upload(folder, url, token, document, pictures):
    """With only the generated client."""
    sys.path.insert(0, str(folder))
    from generated import AuthenticatedClient
    from generated.api.service import get_health, get_reason_codes
    from generated.api.uploads import announce_batch, complete_upload, get_pack_offset, get_upload, send_part
    from generated.models import Batch
    from generated.types import File
    client = AuthenticatedClient(base_url=url, token=token)
    for name, call in (("health", get_health), ("reason codes", get_reason_codes)):
        print(f"{name}: {call.sync_detailed(client=client).status_code}")
    batch = document["signed"]["batch"]
    announced = announce_batch.sync(client=client, body=Batch.from_dict(document), idempotency_key=batch)
    again = announce_batch.sync_detailed(client=client, body=Batch.from_dict(document), idempotency_key=batch)
    print(f"announced: {len(announced.missing)} missing, {len(announced.known)} known, {len(announced.refused)} refused;"
          f" again: {again.status_code}, the same upload: {again.parsed.upload_id == announced.upload_id}")
    if announced.missing:
        pack = pack_of([pictures[sha] for sha in announced.missing])
        name = hashlib.sha256(pack).hexdigest()
        for begin in range(0, len(pack), min(announced.part_max, 1 << 20)):
            part = pack[begin:begin + min(announced.part_max, 1 << 20)]
            digest = f"sha-256=:{base64.b64encode(hashlib.sha256(part).digest()).decode()}:"
            sent = send_part.sync_detailed(announced.upload_id, name, client=client, body=File(payload=io.BytesIO(part)),
                                           upload_offset=begin, upload_length=len(pack), content_digest=digest)
            assert sent.status_code == 204, (sent.status_code, sent.content)
        reached = get_pack_offset.sync_detailed(announced.upload_id, name, client=client)
        print(f"pack of {len(pack)} bytes: {sent.status_code}, Upload-Offset {reached.headers['Upload-Offset']}")
    print(f"complete: {complete_upload.sync_detailed(announced.upload_id, client=client).status_code}")
    for _ in range(600):
        status = get_upload.sync(announced.upload_id, client=client)
        if status.state == "judged":
            break
        time.sleep(0.1)
    verdicts = [tile.verdict.value for tile in status.tiles]
    print("verdicts: " + ", ".join(f"{verdicts.count(word)} {word}" for word in sorted(set(verdicts))))
    return "pending" not in verdicts and len(verdicts) == len(pictures)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for option in ("--url", "--token-file", "--candidates", "--key"):
        parser.add_argument(option)
    arguments = parser.parse_args()
    venv = os.environ.get("NADIR_BENCH_VENV")
    if not venv:
        print("NOT RUN: NADIR_BENCH_VENV names no environment with openapi-python-client and openapi-spec-validator")
        return 0
    if pathlib.Path(sys.prefix).resolve() != pathlib.Path(venv).resolve():
        return subprocess.run([f"{venv}/bin/python", "-B", *sys.argv]).returncode  # the generated client needs its httpx
    if subprocess.run([f"{venv}/bin/openapi-spec-validator", CONTRACT]).returncode != 0:
        return 1
    from fault_server import TOKEN, FaultServer
    from support import Flight
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        subprocess.run([f"{venv}/bin/openapi-python-client", "generate", "--path", CONTRACT, "--output-path",
                        folder / "generated", "--meta", "none"], check=True, capture_output=True)
        server = None if arguments.url else FaultServer()
        candidates, key = arguments.candidates, arguments.key
        if candidates is None:
            flight = Flight(folder, MAKE, 100, 20_000)
            candidates, key = flight.candidates, flight.key
        subprocess.run([NADIR, "sync", "stage", candidates, "--outbox", folder / "outbox", "--key", key], check=True)
        with sqlite3.connect(folder / "outbox/outbox.sqlite") as database:
            uuid, text = database.execute(
                "SELECT uuid, text FROM batch JOIN document ON document.batch = batch.id ORDER BY batch.id LIMIT 1").fetchone()
            pictures = {sha.hex(): data for sha, data in database.execute(
                "SELECT sha256, bytes FROM tile JOIN blob ON blob.tile = tile.id JOIN batch ON batch.id = tile.batch"
                " WHERE uuid = ?", (uuid,))}
        token = pathlib.Path(arguments.token_file).read_text().strip() if arguments.token_file else TOKEN
        good = upload(folder, arguments.url or server.url, token, json.loads(text), pictures)
    print("in order" if good else "NOT in order")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
