#!/usr/bin/env python3
"""The candidate service under load: two flights over the same ground, sent by two ground stations at once, in both catalogues.
From the first announcement until every tile is evaluated, every vote closed and every address promoted.

usage: ./run bench candidates [--tiles N] [--keep DIR]     N: of both flights together (100 000)
"""
import argparse
import os
import pathlib
import re
import shutil
import sys
import tempfile
import threading
import time

from measured import BUILD, HERE, must

sys.path[:0] = [str(HERE.parent / "candidates"), str(HERE.parent / "support")]
from ground_station import Service, Station, flights_in, settled  # noqa: E402

PROGRAM = BUILD / "nadir-candidates"


def peak_mb(pid):
    return int(re.search(r"VmHWM:\s+(\d+) kB", pathlib.Path(f"/proc/{pid}/status").read_text()).group(1)) / 1024


def cpu_s(pid):
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def send_all(service, made, flight, failures):
    station = Station(service, made)
    try:
        uploads = [station.upload(flight, number) for number in range(len(list(flight.glob("batch-*.json"))))]
        for upload in uploads:
            verdicts = {tile["verdict"] for tile in station.judged(upload)["tiles"]}
            if verdicts != {"accepted"}:
                raise RuntimeError(f"{upload}: {verdicts}")
    except Exception as error:  # the other station continues; the figures would be meaningless
        failures.append(error)


def measure(name, made, folder, tiles, options=(), env=None):
    service = Service(PROGRAM, made, folder / "data", "--quota-mb", "100000", *options, env=env)
    service.start()
    failures = []
    begun = time.monotonic()
    stations = [threading.Thread(target=send_all, args=(service, made, flight, failures)) for flight in flights_in(made)]
    for station in stations:
        station.start()
    for station in stations:
        station.join()
    judged_s = time.monotonic() - begun
    if failures:
        raise failures[0]
    found = settled(PROGRAM, folder / "data", *options, env=env)
    promoted_s = time.monotonic() - begun
    memory, cpu = peak_mb(service.process.pid), cpu_s(service.process.pid)
    service.stop()
    catalogue = folder / "data" / "catalogue.sqlite"
    size = f"{catalogue.stat().st_size / 1e6:.0f} MB" if catalogue.exists() else "server"
    assert found["tiles"]["accepted"] == tiles and found["tiles"]["promoted"] == tiles // 2, found
    print(f"| {name} | {tiles / judged_s:.0f} | {tiles / promoted_s:.0f} | {promoted_s:.0f} | {cpu:.0f} | {memory:.0f} | {size} |",
          flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--tiles", type=int, default=100_000)
    parser.add_argument("--keep", type=pathlib.Path, help="folder where the flights are made, and used again the next time")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="nadir-bench.", dir="/tmp") as scratch:
        scratch = pathlib.Path(scratch)
        made = args.keep or scratch / "flights"
        if not (made / "root.json").exists():
            must([BUILD / "make_flights", made, "2", str(args.tiles // 2)])
        tile_bytes = sum(pack.stat().st_size for pack in made.rglob("*.pack"))
        print(f"{args.tiles} tiles, {tile_bytes / 1e9:.2f} GB, two stations at once")
        print("| catalogue | judged, tiles/s | promoted, tiles/s | wall s | CPU s of the service | its peak MB | catalogue |")
        print("|---|---|---|---|---|---|---|")
        measure("SpatiaLite", made, scratch / "file", args.tiles)
        shutil.rmtree(scratch / "file")
        from postgres import Server  # ends here with 77 where there is none
        server = Server()
        try:
            server.start(durable=True)
            server.psql("postgres", "CREATE DATABASE bench")
            server.psql("bench", "CREATE EXTENSION postgis")
            measure("PostGIS", made, scratch / "server", args.tiles, ["--catalogue", "PG:dbname=bench"], server.env)
        finally:
            server.remove()


main()
