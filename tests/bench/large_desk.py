#!/usr/bin/env python3
"""Three thousand pictures of 26 megapixels through `nadir desk serve`: memory, throughput, disk, and whether any of it grows with the length.

usage: large_desk.py NADIR FOLDER [--frames N] [--distinct N]     FOLDER is created, holds 10 MB a frame, and is removed at the end

A hundred pictures of a simulated flight are flown to and fro; a comment in each JPEG makes every one another file. The desk gets them in
batches as fast as it takes them, not more than two batches ahead of what it has processed, and completes the flight in the end: smoothed
and adjusted from its pictures. Its memory is read from /proc every second.
"""
import argparse
import csv
import io
import math
import os
import pathlib
import re
import shutil
import statistics
import sys
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "desk"))
import desk_support  # noqa: E402
import support  # noqa: E402

WIDTH, HEIGHT = 6252, 4168
BODY_BYTES = 60_000_000
BAR_MB = 2048
COMPLETION_S = 6 * 3600


def good(*args):
    result = support.run(*args, timeout=3600)
    assert result.returncode == 0, f"{args}\n{result.stdout}\n{result.stderr}"


def make(folder, distinct):
    """A signed package, and a flight over it by a large camera with the same field of view across."""
    good("simulate", "world", "--seed", 7, "--size-km", 2, "--gsd-m", 0.5, "--out", folder / "world")
    for name in ("root", "signer"):
        good("keys", "create", "--out", folder / name)
    good("keys", "root", "--root-key", folder / "root.key.pem", "--package-signer", folder / "signer.pub.pem", "--expires", "2035-01-01", "--out",
         folder / "root.json")
    world = folder / "world"
    good("cache", "build", "--mission", world / "mission.yaml", "--imagery", world / "map.tif", "--dem", world / "dem.tif", "--key",
         folder / "signer.key.pem", "--out", folder / "package")
    text = (world / "camera.yaml").read_text()
    width, focal = (float(re.search(rf"^{name}: *([0-9.]+)", text, re.MULTILINE).group(1)) for name in ("width", "fx"))
    values = {"width": WIDTH, "height": HEIGHT, "fx": focal * WIDTH / width, "fy": focal * WIDTH / width, "cx": WIDTH / 2 - 0.5, "cy": HEIGHT / 2 - 0.5}
    for name, value in values.items():
        text = re.sub(rf"^{name}: *[0-9.]+", f"{name}: {value:g}", text, flags=re.MULTILINE)
    (folder / "large.yaml").write_text(text)
    good("simulate", "flight", "--world", world / "ground.tif", "--dem", world / "dem.tif", "--mission", world / "mission.yaml", "--camera",
         folder / "large.yaml", "--seed", 11, "--max-frames", distinct, "--out", folder / "flight")


def to_and_fro(count, frames):
    """Indices of pictures: to the last one and back, without showing one twice in a row."""
    period = [*range(count), *range(count - 2, 0, -1)]
    return [period[i % len(period)] for i in range(frames)]


def with_comment(jpeg, text):
    assert jpeg[:2] == b"\xff\xd8"
    return jpeg[:2] + b"\xff\xfe" + (len(text) + 2).to_bytes(2, "big") + text + jpeg[2:]


class Memory(threading.Thread):
    """The desk's resident memory, once a second: (seconds, MB)."""

    def __init__(self, pid):
        super().__init__(daemon=True)
        self.status, self.stat, self.began, self.seen = f"/proc/{pid}/status", f"/proc/{pid}/stat", time.monotonic(), []

    def of(self, name):
        return int(re.search(rf"^{name}:\s*(\d+) kB", pathlib.Path(self.status).read_text(), re.MULTILINE).group(1)) / 1024

    def cpu_s(self):
        fields = pathlib.Path(self.stat).read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def run(self):
        try:
            while True:
                self.seen.append((time.monotonic() - self.began, self.of("VmRSS")))
                time.sleep(1)
        except (OSError, AttributeError):  # the desk has ended
            return


def progress(text):
    print(time.strftime("%H:%M:%S ") + text, file=sys.stderr, flush=True)


def waited(desk, flight, done, patience_s):
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        document = desk.json("GET", flight, expect=200)
        assert document["state"] not in ("blocked", "damaged"), document
        if done(document):
            return document
        time.sleep(0.5)
    raise AssertionError(f"not done after {patience_s} s: {document}")


def errors_m(desk, flight, kind, truth):
    rows = csv.DictReader(io.StringIO(desk.call("GET", f"{flight}/export?format=csv&kind={kind}")[2].decode()))
    found = []
    for row in rows:
        if not row["lat_deg"]:
            continue
        lat, lon = truth[row["frame"]]
        found.append(math.hypot((float(row["lon_deg"]) - lon) * 111319.49 * math.cos(math.radians(lat)), (float(row["lat_deg"]) - lat) * 111200.0))
    return sorted(found)


def fly(desk, folder, frames):
    flown = list(csv.DictReader((folder / "flight" / "telemetry.csv").read_text().splitlines()))
    positions = {row["frame"]: (float(row["lat_deg"]), float(row["lon_deg"]))
                 for row in csv.DictReader((folder / "flight" / "truth.csv").read_text().splitlines())}
    interval_s = float(flown[1]["time_s"]) - float(flown[0]["time_s"])
    pictures = [(folder / "flight" / "frames" / row["frame"]).read_bytes() for row in flown]
    order = to_and_fro(len(flown), frames)
    batch = min(50, int(BODY_BYTES / max(map(len, pictures))))
    sent_folder = folder / "batch"
    sent_folder.mkdir()
    truth = {}
    memory = Memory(desk.process.pid)
    memory.start()
    start = positions[flown[0]["frame"]]
    flight = desk.create(name="large pictures", package="valley", start={"lat": start[0], "lon": start[1]})
    began, at_frames, intake_s, pictures_mb = time.monotonic(), [], [], 0
    for first in range(0, frames, batch):
        rows, files = [], []
        for i in range(first, min(frames, first + batch)):
            name = f"{i:06}.jpg"
            rows.append({**flown[order[i]], "frame": name, "time_s": f"{i * interval_s:.3f}"})
            truth[name] = positions[flown[order[i]]["frame"]]
            path = sent_folder / name
            path.write_bytes(with_comment(pictures[order[i]], f"picture {i} of the flight".encode()))
            files.append(path)
            pictures_mb += path.stat().st_size / 1e6
        table = io.StringIO()
        writer = csv.DictWriter(table, fieldnames=list(flown[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        sending = time.monotonic()
        answers = desk.send(flight, files, table.getvalue())
        intake_s.append((time.monotonic() - sending) / len(files))
        assert {answer["outcome"] for answer in answers.values()} == {"accepted"}, answers
        for path in files:
            path.unlink()
        document = waited(desk, flight, lambda d: d["pictures"]["accepted"] - d["pictures"]["processed"] <= 2 * batch, 1800)
        at_frames.append((document["pictures"]["processed"], memory.of("VmRSS")))
        if (first // batch) % 10 == 0:
            progress(f"{at_frames[-1][0]} of {frames} frames, {at_frames[-1][1]:.0f} MB, {time.monotonic() - began:.0f} s")
    waited(desk, flight, lambda d: d["pictures"]["accepted"] == d["pictures"]["processed"] and d["state"] == "idle", 3600)
    processed_s, processed_cpu_s, processing_peak = time.monotonic() - began, memory.cpu_s(), memory.of("VmHWM")
    progress(f"{frames} frames processed, peak {processing_peak:.0f} MB, {processed_s:.0f} s")
    completing = time.monotonic()
    desk.json("POST", flight + "/complete", expect=202)
    waited(desk, flight, lambda d: d["state"] == "completed" and not d["completion_requested"], COMPLETION_S)
    completed_s, completed_cpu_s, peak = time.monotonic() - completing, memory.cpu_s() - processed_cpu_s, memory.of("VmHWM")
    estimates = list(csv.DictReader(io.StringIO(desk.call("GET", flight + "/export?format=csv&kind=online")[2].decode())))
    latencies = sorted(float(row["latency_ms"]) for row in estimates)
    thirds = [statistics.median(float(row["latency_ms"]) for row in estimates[k * frames // 3:(k + 1) * frames // 3]) for k in range(3)]
    stored = folder / "desk" / "flights"
    files = [path for path in stored.rglob("*") if path.is_file()]
    whole_mb = sum(path.stat().st_size for path in files) / 1e6
    print(f"{frames} pictures of {WIDTH} x {HEIGHT}, {statistics.mean(map(len, pictures)) / 1e6:.1f} MB each, {len(pictures)} distinct\n")
    print("| | measured | bar |\n|---|---|---|")
    print(f"| frame, median, 99 % | {statistics.median(latencies):.0f}, {latencies[int(0.99 * frames)]:.0f} ms | ≤ 300 ms |")
    print(f"| … median of the first, second, last third | {', '.join(f'{t:.0f}' for t in thirds)} ms | |")
    print(f"| sending a picture, mean | {1000 * statistics.mean(intake_s):.0f} ms | |")
    print(f"| all frames, sending included | {processed_s:.0f} s, {processed_cpu_s:.0f} s of CPU time | |")
    print(f"| completing: smoothed and adjusted | {completed_s:.0f} s, {completed_cpu_s:.0f} s of CPU time | |")
    for share in (0.1, 0.25, 0.5, 0.75, 1.0):
        number, mb = min(at_frames, key=lambda at: abs(at[0] - share * frames))
        print(f"| memory after {number} frames | {mb:.0f} MB | |")
    print(f"| memory, peak of processing | {processing_peak:.0f} MB | ≤ {BAR_MB} MB |")
    print(f"| memory, peak of all | {peak:.0f} MB | ≤ {BAR_MB} MB |")
    print(f"| memory at the end | {memory.of('VmRSS'):.0f} MB | |")
    print(f"| disk: pictures, all else | {pictures_mb / 1000:.1f} GB, {whole_mb - pictures_mb:.0f} MB ({1000 * (whole_mb - pictures_mb) / frames:.0f} kB a frame) | |")
    for kind in ("online", "refined", "adjusted"):
        off = errors_m(desk, flight, kind, truth)
        if off:
            print(f"| {kind}: frames, median, 95 % off | {len(off)}, {statistics.median(off):.2f} m, {off[int(0.95 * (len(off) - 1))]:.2f} m | |")
    return peak <= BAR_MB


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("nadir")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--frames", type=int, default=3000)
    parser.add_argument("--distinct", type=int, default=100)
    wanted = parser.parse_args()
    support.NADIR = wanted.nadir
    wanted.folder.mkdir()
    try:
        make(wanted.folder, wanted.distinct)
        progress("pictures made")
        desk = desk_support.Desk(wanted.folder / "desk", wanted.folder).start()
        try:
            within = fly(desk, wanted.folder, wanted.frames)
        finally:
            desk.stop()
    finally:
        shutil.rmtree(wanted.folder)
    return 0 if within else 1


if __name__ == "__main__":
    sys.exit(main())
