#!/usr/bin/env python3
"""The candidate service under load: two flights over the same ground, sent by two ground stations at once, in both catalogues.
From the first announcement until every tile is evaluated, every vote closed and every address promoted. Then the work of the
judges alone, on PostGIS, by one, two and four of them (--workers).

usage: ./run bench candidates [--tiles N] [--keep DIR] [--only PART] [--workers N…] [--against PROGRAM]
N: of both flights together (100 000). PART: file, server, workers. PROGRAM: nadir-candidates of another commit, side by side.
"""
import argparse
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time

from measured import BUILD, HERE, must

sys.path[:0] = [str(HERE.parent / "candidates"), str(HERE.parent / "support")]
from ground_station import Service, Station, flights_in, settled  # noqa: E402

PROGRAM = BUILD / "nadir-candidates"
RETRY_AFTER_S = 2  # of the service's answers while tiles are pending


def peak_mb(pid):
    return int(re.search(r"VmHWM:\s+(\d+) kB", pathlib.Path(f"/proc/{pid}/status").read_text()).group(1)) / 1024


def cpu_s(pid):
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def cpu_of_all(name):
    """CPU seconds of the processes of this name, and of those that they have waited for."""
    ticks = 0
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            if (folder / "comm").read_text().strip() == name:
                ticks += sum(int(field) for field in (folder / "stat").read_text().rsplit(")", 1)[1].split()[11:15])
        except OSError:  # it has ended
            continue
    return ticks / os.sysconf("SC_CLK_TCK")


def judged(station, upload):
    """Asks as often as the service wishes."""
    while (status := station.status(upload))["state"] != "judged":
        time.sleep(RETRY_AFTER_S)
    return status


def send_all(service, made, flight, failures):
    station = Station(service, made)
    try:
        uploads = [station.upload(flight, number) for number in range(len(list(flight.glob("batch-*.json"))))]
        for upload in uploads:
            verdicts = {tile["verdict"] for tile in judged(station, upload)["tiles"]}
            if verdicts != {"accepted"}:
                raise RuntimeError(f"{upload}: {verdicts}")
    except Exception as error:  # the other station continues; the figures would be meaningless
        failures.append(error)


def measure(name, program, made, folder, tiles, options=(), server=None):
    env = server.env if server else None
    service = Service(program, made, folder / "data", "--quota-mb", "100000", *options, env=env)
    service.start()
    failures = []
    begun, server_cpu_s = time.monotonic(), cpu_of_all("postgres")
    stations = [threading.Thread(target=send_all, args=(service, made, flight, failures)) for flight in flights_in(made)]
    for station in stations:
        station.start()
    for station in stations:
        station.join()
    judged_s = time.monotonic() - begun
    if failures:
        raise failures[0]
    found = settled(program, folder / "data", *options, env=env)
    promoted_s = time.monotonic() - begun
    memory, cpu = peak_mb(service.process.pid), cpu_s(service.process.pid)
    service.stop()
    catalogue = folder / "data" / "catalogue.sqlite"
    size = f"{catalogue.stat().st_size / 1e6:.0f} MB" if catalogue.exists() else "server"
    statements = ""
    if server:
        calls = server.psql("bench", "SELECT sum(calls) FROM pg_stat_statements")
        commits = server.psql("bench", "SELECT xact_commit FROM pg_stat_database WHERE datname = 'bench'")
        statements = f"{cpu_of_all('postgres') - server_cpu_s:.0f} | {calls} | {commits}"
    assert found["tiles"]["accepted"] == tiles and found["tiles"]["promoted"] == tiles // 2, found
    print(f"| {name} | {tiles / judged_s:.0f} | {tiles / promoted_s:.0f} | {promoted_s:.0f} | {cpu:.0f} | {memory:.0f} | {size} | {statements} |",
          flush=True)
    shutil.rmtree(folder)


def started_server():
    from postgres import Server  # ends here with 77 where there is none
    server = Server()
    with open(server.folder / "data" / "postgresql.conf", "a") as settings:
        settings.write("shared_preload_libraries = 'pg_stat_statements'\n")
    server.start(durable=True)
    return server


def new_database(server, name):
    server.psql("postgres", f"CREATE DATABASE {name}")
    server.psql(name, "CREATE EXTENSION postgis")
    server.psql(name, "CREATE EXTENSION pg_stat_statements")


def measure_server(name, program, made, folder, tiles):
    server = started_server()
    try:
        new_database(server, "bench")
        measure(name, program, made, folder, tiles, ["--catalogue", "PG:dbname=bench"], server)
    finally:
        server.remove()


def measure_workers(made, folder, tiles, counts):
    """Everything is sent, and nothing judged: then by one, two and four processes."""
    server = started_server()
    try:
        new_database(server, "sent")
        service = Service(PROGRAM, made, folder / "sent", "--quota-mb", "100000", "--catalogue", "PG:dbname=sent", "--workers", "0",
                          env=server.env)
        service.start()
        station = Station(service, made)
        for flight in flights_in(made):
            for number in range(len(list(flight.glob("batch-*.json")))):
                station.upload(flight, number)
        station.close()
        service.stop()
        server.psql("sent", "VACUUM ANALYZE")
        print("\n| workers | tiles/s | wall s | CPU s of the workers | of the server | their wait for the database | ms of a core for a tile |")
        print("|---|---|---|---|---|---|---|")
        for workers in counts:
            name = f"by{workers}"
            server.psql("postgres", f"CREATE DATABASE {name} TEMPLATE sent")
            subprocess.run(["cp", "-al", folder / "sent", folder / name], check=True)
            begun, server_cpu_s = time.monotonic(), cpu_of_all("postgres")
            before = os.times()
            processes = [subprocess.Popen([PROGRAM, "work", "--data", folder / name, "--catalogue", f"PG:dbname={name}", "--until-done",
                                           "--json", "--quiet"], env=server.env, stdout=subprocess.PIPE, text=True) for _ in range(workers)]
            done = [json.loads(process.communicate()[0]) for process in processes]
            wall_s, after = time.monotonic() - begun, os.times()
            cpu = after.children_user + after.children_system - before.children_user - before.children_system
            server_cpu_s = cpu_of_all("postgres") - server_cpu_s
            busy_s, catalogue_s = sum(one["busy_s"] for one in done), sum(one["catalogue_s"] for one in done)
            promoted = int(server.psql(name, "SELECT count(*) FROM nadir_candidates.promotions WHERE current = 1"))
            assert promoted == tiles // 2 and sum(one["tiles"] for one in done) == tiles, (promoted, done)
            print(f"| {workers} | {tiles / wall_s:.0f} | {wall_s:.1f} | {cpu:.1f} | {server_cpu_s:.1f} | {catalogue_s / busy_s:.0%} | "
                  f"{(cpu + server_cpu_s) * 1000 / tiles:.2f} |", flush=True)
            server.psql("postgres", f"DROP DATABASE {name}")
    finally:
        server.remove()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--tiles", type=int, default=100_000)
    parser.add_argument("--keep", type=pathlib.Path, help="folder where the flights are made, and used again the next time")
    parser.add_argument("--only", choices=["file", "server", "workers"], help="one part")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4], help="processes that judge at a time")
    parser.add_argument("--against", type=pathlib.Path, help="nadir-candidates of another commit, measured beside this one's")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="nadir-bench.", dir="/tmp") as scratch:
        scratch = pathlib.Path(scratch)
        made = args.keep or scratch / "flights"
        if not (made / "root.json").exists():
            must([BUILD / "make_flights", made, "2", str(args.tiles // 2)])
        tile_bytes = sum(pack.stat().st_size for pack in made.rglob("*.pack"))
        print(f"{args.tiles} tiles, {tile_bytes / 1e9:.2f} GB, two stations at once; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
        programs = [("", PROGRAM)] + ([(" (the other commit)", args.against)] if args.against else [])
        if args.only != "workers":
            print("| catalogue | judged, tiles/s | promoted, tiles/s | wall s | CPU s of the service | its peak MB | catalogue | CPU s of the server "
                  "| statements | transactions |")
            print("|---|---|---|---|---|---|---|---|---|---|")
        for name, program in programs:
            if args.only in (None, "file"):
                measure("SpatiaLite" + name, program, made, scratch / "file", args.tiles)
            if args.only in (None, "server"):
                measure_server("PostGIS" + name, program, made, scratch / "server", args.tiles)
        if args.only in (None, "workers"):
            measure_workers(made, scratch, args.tiles, args.workers)


main()
