#!/usr/bin/env python3
"""The desk as its clients meet it: `nadir desk serve` over HTTP on this machine, with pictures of 1920 × 1080 of a simulated flight.

usage: desk_service.py NADIR

Creating a flight over a verified package, a batch of fifty pictures, a frame, how long after the fact its event arrives, and the
refinement of the flight, each beside its bar. A person waits for these; the bars are those of two cores.
"""
import csv
import datetime
import http.client
import json
import pathlib
import shutil
import statistics
import sys
import tempfile
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "desk"))
import desk_support  # noqa: E402
from desk_support import Desk  # noqa: E402
import support  # noqa: E402

BATCH, BATCHES = 50, 2


def make(folder):
    desk_support.FRAMES = BATCH * BATCHES
    desk_support.make_world(folder)
    camera = folder / "flight" / "camera.yaml"
    text = camera.read_text()
    values = {line.split(":")[0]: float(line.split(":")[1].split("#")[0]) for line in text.splitlines()
              if line.split(":")[0] in ("width", "height", "fx", "fy", "cx", "cy")}
    factor = 1920 / values["width"]
    larger = "\n".join(f"{line.split(':')[0]}: {round(values[line.split(':')[0]] * factor, 1):g}" if line.split(":")[0] in values else line
                       for line in text.splitlines()) + "\n"
    shutil.rmtree(folder / "flight")
    (folder / "hd.yaml").write_text(larger)
    world = folder / "world"
    made = support.run("simulate", "flight", "--world", world / "ground.tif", "--dem", world / "dem.tif", "--mission", world / "mission.yaml", "--camera",
                       folder / "hd.yaml", "--seed", 11, "--max-frames", BATCH * BATCHES, "--interval-s", 0.5, "--out", folder / "flight")
    assert made.returncode == 0, made.stderr


class Listener(threading.Thread):
    """Reads a flight's events and notes how long after its time each arrives."""

    def __init__(self, desk, flight, frames):
        super().__init__(daemon=True)
        self.connection = http.client.HTTPConnection("127.0.0.1", desk.port, timeout=600)
        self.connection.request("GET", flight + "/events")
        self.response, self.frames, self.delays_ms = self.connection.getresponse(), frames, []

    def run(self):
        kind = None
        while len(self.delays_ms) < self.frames:
            line = self.response.readline().decode().rstrip("\n")
            if line.startswith("event: "):
                kind = line[7:]
            if line.startswith("data: ") and kind == "frame_processed":
                happened = time_of(json.loads(line[6:])["time"])
                self.delays_ms.append(1000 * (time.time() - happened))
        self.connection.close()


def time_of(text):
    return datetime.datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp()


def row(what, value, unit, bar):
    print(f"| {what:<46} | {value:>9.3f} {unit:<2} | {bar:<10} |", flush=True)


def main():
    with tempfile.TemporaryDirectory(prefix="nadir-bench.") as name:
        folder = pathlib.Path(name)
        (folder / "made").mkdir()
        make(folder / "made")
        desk = Desk(folder / "desk", folder / "made").start()
        try:
            desk.json("GET", "/v1/packages", expect=200)  # verified with the first request
            began = time.monotonic()
            flight = desk.create(name="bench", package="valley")
            row("create a flight over a verified package", 1000 * (time.monotonic() - began), "ms", "< 500 ms")
            frames = desk.frames()
            listener = Listener(desk, flight, len(frames))
            listener.start()
            spent = []
            for first in range(0, len(frames), BATCH):
                began = time.monotonic()
                answers = desk.send(flight, frames[first:first + BATCH])
                spent.append(time.monotonic() - began)
                assert {answer["outcome"] for answer in answers.values()} == {"accepted"}, answers
            megabytes = sum(path.stat().st_size for path in frames) / len(frames) / 1e6
            row(f"batch of 50 pictures of {megabytes:.2f} MB, longest", max(spent), "s", "< 2 s")
            desk.settled(flight)
            listener.join(60)
            estimates = list(csv.DictReader(desk.call("GET", flight + "/export?format=csv&kind=online")[2].decode().splitlines()))
            latencies = [float(estimate["latency_ms"]) for estimate in estimates]
            row("frame, median", statistics.median(latencies), "ms", "≤ 300 ms")
            row("frame, 95 %", sorted(latencies)[int(0.95 * len(latencies))], "ms", "≤ 300 ms")
            row("event after the fact, median", statistics.median(listener.delays_ms), "ms", "< 500 ms")
            row("event after the fact, longest", max(listener.delays_ms), "ms", "< 500 ms")
            began = time.monotonic()
            desk.json("POST", flight + "/complete", expect=202)
            desk.settled(flight)
            row(f"completing a flight of {len(frames)} frames", time.monotonic() - began, "s", "")
            anchored = sum(estimate["source"] == "satellite_anchored" for estimate in estimates)
            print(f"{len(estimates)} frames, {anchored} anchored")
        finally:
            desk.stop()


main()
