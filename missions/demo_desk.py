#!/usr/bin/env python3
"""The demo's flight at the desk: copies the package into the desk's folder, starts `nadir desk serve`, sends the flight's frames in batches
as any client would, and completes the flight. Then the desk stays open until Ctrl-C.

usage: demo_desk.py DEMO [--nadir PROGRAM] [--at TIME] [--start LON,LAT] [--listen IP:PORT] [--leave]

DEMO      folder with package/, root.json, flight/ (frames/, telemetry.csv) and world/camera.yaml; receives desk/
--leave   stop the desk when the flight is completed

A flight that is at the desk already is not sent again.
"""
import argparse
import json
import pathlib
import shutil
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
import uuid

BATCH = 20
PATIENCE_S = 600
NAME = "Demo flight"


def request(url, body=None, kind="application/json"):
    """The JSON that answers; SystemExit with the desk's own words when it refuses."""
    try:
        with urllib.request.urlopen(urllib.request.Request(url, data=body, headers={"Content-Type": kind}), timeout=PATIENCE_S) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        raise SystemExit(f"error: the desk answers {error.code} to {url}: {error.read().decode(errors='replace')}") from error


def send(flight_url, pictures, telemetry):
    boundary = uuid.uuid4().hex
    parts = [('telemetry"; filename="telemetry.csv', "text/csv", telemetry)]
    parts += [(f'picture"; filename="{path.name}', "image/jpeg", path.read_bytes()) for path in pictures]
    body = b"".join(f'--{boundary}\r\nContent-Disposition: form-data; name="{name}"\r\nContent-Type: {kind}\r\n\r\n'.encode() + data + b"\r\n"
                    for name, kind, data in parts) + f"--{boundary}--\r\n".encode()
    answer = request(flight_url + "/pictures", body, f"multipart/form-data; boundary={boundary}")
    refused = [picture for picture in answer["pictures"] if picture["outcome"] not in ("accepted", "known")]
    if refused:
        raise SystemExit(f"error: the desk refuses pictures of the demo: {refused}")


def settled(flight_url):
    """The flight's document, once everything that was asked for is done."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        flight = request(flight_url)
        if flight["state"] in ("blocked", "damaged"):
            raise SystemExit(f"error: the flight is {flight['state']}: {flight['reason']}")
        if flight["completed"]:
            return flight
        time.sleep(0.2)
    raise SystemExit(f"error: the flight was not completed within {PATIENCE_S} s: {flight}")


def put_on_desk(url, demo, start):
    """The identifier of the demo's flight, and its document."""
    for flight in request(url + "/v1/flights")["flights"]:
        if flight["name"] == NAME and flight["completed"]:
            return flight["id"], flight
    wanted = {"name": NAME, "package": "demo", "camera": (demo / "world" / "camera.yaml").read_text()}
    if start:
        lon, lat = map(float, start.split(","))
        wanted["start"] = {"lon": lon, "lat": lat}
    flight = request(url + "/v1/flights", json.dumps(wanted).encode())["id"]
    flight_url = f"{url}/v1/flights/{flight}"
    frames, telemetry = sorted((demo / "flight" / "frames").iterdir()), (demo / "flight" / "telemetry.csv").read_bytes()
    for first in range(0, len(frames), BATCH):
        send(flight_url, frames[first:first + BATCH], telemetry)
    request(flight_url + "/complete", b"")
    return flight, settled(flight_url)


def begin(options, demo):
    """The desk's process, and its address."""
    root, port_file = demo / "desk", demo / "desk" / "port"
    if not (root / "packages" / "demo").exists():
        shutil.copytree(demo / "package", root / "packages" / "demo")
    port_file.unlink(missing_ok=True)
    command = [options.nadir, "desk", "serve", "--root", root, "--trust", demo / "root.json", "--listen", options.listen, "--port-file", port_file, "--quiet"]
    if options.at:
        command += ["--at", options.at]
    desk = subprocess.Popen(list(map(str, command)), stdin=subprocess.DEVNULL)
    while not port_file.exists() or not port_file.read_text().endswith("\n"):
        if desk.poll() is not None:
            raise SystemExit(f"error: the desk does not start (exit code {desk.returncode})")
        time.sleep(0.05)
    return desk, f"http://{options.listen.rsplit(':', 1)[0]}:{port_file.read_text().strip()}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("demo", type=pathlib.Path)
    parser.add_argument("--nadir", default="build/bin/nadir")
    parser.add_argument("--at")
    parser.add_argument("--start")
    parser.add_argument("--listen", default="127.0.0.1:0")
    parser.add_argument("--leave", action="store_true")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: the desk is stopped on the way out
    desk, url = begin(options, options.demo)
    try:
        flight, document = put_on_desk(url, options.demo, options.start)
        print(f"  the flight is at the desk: {document['pictures']['processed']} pictures, {document['state']}", flush=True)
        if not options.leave:
            print(f"\n  The desk is open at {url}/#{flight}\n  Ctrl-C closes it. Later: {options.nadir} desk serve --root {options.demo}/desk"
                  f" --trust {options.demo}/root.json" + (f" --at {options.at}" if options.at else ""), flush=True)
            return desk.wait()
    except KeyboardInterrupt:
        print()
    finally:
        if desk.poll() is None:
            desk.terminate()
            desk.wait(30)
    return 0


sys.exit(main())
