#!/usr/bin/env python3
"""`nadir sync` over unreliable connections: losses, duplicates and cost; and what curl and rsync, repeated until they
succeed, need for the same tiles over the same connection.

usage: ./run bench sync [--tiles N] [--mean-bytes N] [--seeds N…] [--kills N] [--cuts N]
"""
import argparse
import collections
import http.server
import json
import os
import pathlib
import random
import shutil
import socket
import sqlite3
import struct
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "sync"))
from fault_server import FaultServer, Faults  # noqa: E402
from fault_service import Service  # noqa: E402
from support import TEMPORARY, Flight, discrepancies, push, sync, tiles  # noqa: E402

KILLED, MAKE = ROOT / "build/bin/test_killed_sync", ROOT / "build/bin/test_make_candidates"


class Relay:
    """A line between a client and a port: counts what goes out, and breaks (a reset) after so many bytes."""

    def __init__(self, port, cuts=()):
        self.port, self.cuts, self.out, self.back, self.broken = port, sorted(cuts), 0, 0, 0
        self.lock = threading.Lock()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self.listener.getsockname()[1]}"
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            server = socket.create_connection(("127.0.0.1", self.port))
            for line in (client, server):
                line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for source, target, outward in ((client, server, True), (server, client, False)):
                threading.Thread(target=self.pump, args=(source, target, outward), daemon=True).start()

    def pump(self, source, target, outward):
        try:
            while data := source.recv(1 << 16):
                with self.lock:
                    if outward:
                        self.out += len(data)
                    else:
                        self.back += len(data)
                    cut = bool(outward and self.cuts and self.out >= self.cuts[0])
                    if cut:
                        self.cuts.pop(0)
                        self.broken += 1
                if cut:
                    for line in (source, target):
                        line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                        line.close()
                    return
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)
        except OSError:
            for line in (source, target):
                try:
                    line.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass

    def stop(self):
        self.listener.close()


class TileFolder(http.server.BaseHTTPRequestHandler):
    """A minimal server for curl: accepts PUT and stores the bytes."""
    protocol_version = "HTTP/1.1"

    def do_PUT(self):
        size = int(self.headers["Content-Length"])
        body = self.rfile.read(size)
        with self.server.lock:
            self.server.requests += 1
            if len(body) == size:
                self.server.kept[self.path] = body
        self.send_response(201)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def handle(self):
        try:
            super().handle()
        except OSError:
            pass

    def log_message(self, *args):
        pass


def staged(folder, arguments, seed):
    flight = Flight(folder, MAKE, arguments.tiles, arguments.mean_bytes, seed)
    outbox = folder / "outbox"
    begin = time.monotonic()
    result = sync(KILLED, "stage", flight.candidates, "--outbox", outbox, "--key", flight.key, seed=seed)
    assert result.returncode == 0, result.stderr
    return outbox, time.monotonic() - begin


def payload_of(outbox):
    with sqlite3.connect(f"file:{outbox}/outbox.sqlite?mode=ro", uri=True) as database:
        return database.execute("SELECT sum(size) FROM tile").fetchone()[0]


def faults_and_kills(arguments, seed):
    """Every fault, and kills at random transitions and requests, until all is done: lost and counted twice."""
    with tempfile.TemporaryDirectory(dir=TEMPORARY) as name:
        folder, dice = pathlib.Path(name), random.Random(seed)
        outbox, stage_s = staged(folder, arguments, seed)
        service = Service(part_max=1 << 17, judge=lambda s: "blurred" if s["x"] % 17 == 0 else None)
        server = FaultServer(service, Faults(seed, rate=0.2, most=6 * arguments.kills))
        kills, calls = collections.Counter(), 0
        begin = time.monotonic()
        while True:
            calls += 1
            kill = dice.randrange(1, 60) if kills.total() < arguments.kills else None
            result = push(KILLED, outbox, server.url, kill_count=kill, seed=dice.randrange(1 << 30))
            if result.returncode == -9:
                kills[result.stderr.rsplit("killed at ", 1)[1].strip()] += 1
                continue
            assert result.returncode in (0, 1), result.stderr
            if "PARKED" not in {state for state, _ in tiles(outbox).values()}:
                break
            assert sync(KILLED, "retry", outbox).returncode == 0
        server.stop()
        ours, wrong = tiles(outbox), discrepancies(outbox, service, arguments.tiles)
        twice = sum(count > 1 for count in service.accepted.values())
        lost = sum(not (service.accepted[name] or service.rejected[name]) for name in ours)
        states = collections.Counter(state for state, _ in ours.values())
        print(f"seed {seed}: {len(ours)} tiles, {sum(server.faults.done.values())} faults of {len(server.faults.done)} kinds, "
              f"{kills.total()} kills at {len(kills)} points: {lost} lost, {twice} counted twice, {len(wrong)} discrepancies; "
              f"{dict(states)}; staged in {stage_s:.1f} s, sent in {time.monotonic() - begin:.1f} s")
        return not (wrong or twice or lost)


def cuts_for(arguments, payload, seed):
    dice = random.Random(seed)
    return [dice.randrange(payload) for _ in range(arguments.cuts)]


def over_a_broken_line(arguments, seed):
    """The same cuts for nadir, curl and rsync: requests, bytes sent, over the payload."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        outbox, _ = staged(folder, arguments, seed)
        payload = payload_of(outbox)
        rows = []
        server = FaultServer(Service())
        relay = Relay(int(server.url.rsplit(":", 1)[1]), cuts_for(arguments, payload, seed))
        result = push(KILLED, outbox, relay.url)
        assert result.returncode == 0, result.stderr
        wrong = discrepancies(outbox, server.service, arguments.tiles)
        rows.append(("nadir sync push", 1, server.service.requests.total(), relay))
        server.stop()
        relay.stop()
        pictures = folder / "pictures"
        pictures.mkdir()
        with sqlite3.connect(f"file:{outbox}/outbox.sqlite?mode=ro", uri=True) as database:
            for number, data in database.execute("SELECT tile, bytes FROM blob"):
                (pictures / f"{number}.jpg").write_bytes(data)
        rows.append(curl_per_tile(folder, pictures, cuts_for(arguments, payload, seed)))
        rows.append(rsync_partial(folder, pictures, cuts_for(arguments, payload, seed)))
        print(f"\nseed {seed}: {arguments.tiles} tiles, {payload / 1e6:.1f} MB, {arguments.cuts} cuts")
        print(f"{'':28}{'cuts':>6}{'calls':>7}{'requests':>10}{'MB out':>9}{'of payload':>12}{'MB back':>9}")
        for row in rows:
            if row[3] is None:
                print(f"{row[0]:28}NOT RUN: it is not installed")
                continue
            title, calls, requests, line = row
            print(f"{title:28}{line.broken:>6}{calls:>7}{requests:>10}{line.out / 1e6:>9.1f}{line.out / payload:>12.3f}"
                  f"{line.back / 1e6:>9.2f}")
        good = not wrong and rows[0][3].out <= 1.1 * payload
        return good


def curl_per_tile(folder, pictures, cuts):
    title = "curl -T, tile by tile"
    if not shutil.which("curl"):
        return title, 0, 0, None
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), TileFolder)
    server.daemon_threads, server.lock, server.requests, server.kept = True, threading.Lock(), 0, {}
    threading.Thread(target=server.serve_forever, daemon=True).start()
    relay, calls = Relay(server.server_address[1], cuts), 0
    config = folder / "curl.txt"
    left = sorted(pictures.iterdir())
    while left:  # what has not arrived, in one call; a break ends one transfer, curl continues with the next
        calls += 1
        config.write_text("".join(f'upload-file = "{p}"\nurl = "{relay.url}/{p.name}"\noutput = "/dev/null"\n' for p in left))
        subprocess.run(["curl", "-sS", "-H", "Expect:", "-K", config], capture_output=True)
        left = [p for p in left if server.kept.get("/" + p.name) != p.read_bytes()]
    server.shutdown()
    server.server_close()
    relay.stop()
    return title, calls, server.requests, relay


def rsync_partial(folder, pictures, cuts):
    title = "rsync --partial, in a loop"
    if not shutil.which("rsync"):
        return title, 0, 0, None
    target = folder / "target"
    target.mkdir()
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    (folder / "rsyncd.conf").write_text(f"[tiles]\npath = {target}\nread only = false\nuse chroot = false\n"
                                        f"lock file = {folder}/rsync.lock\nuid = {os.getuid()}\ngid = {os.getgid()}\n")
    daemon = subprocess.Popen(["rsync", "--daemon", "--no-detach", "--address=127.0.0.1", f"--port={port}",
                               f"--config={folder}/rsyncd.conf"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while True:
        try:
            socket.create_connection(("127.0.0.1", port)).close()
            break
        except OSError:
            time.sleep(0.05)
    relay, calls, code = Relay(port, cuts), 0, 1
    while code != 0 and calls < 10 * len(cuts) + 10:
        calls += 1
        code = subprocess.run(["rsync", "-a", "--partial", f"{pictures}/", relay.url.replace("http:", "rsync:") + "/tiles/"],
                              capture_output=True).returncode
    daemon.terminate()
    daemon.wait()
    relay.stop()
    return title, calls, calls, relay


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tiles", type=int, default=10_000)
    parser.add_argument("--mean-bytes", type=int, default=20_000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--kills", type=int, default=60)
    parser.add_argument("--cuts", type=int, default=20)
    arguments = parser.parse_args()
    good = [faults_and_kills(arguments, seed) for seed in arguments.seeds]
    good += [over_a_broken_line(arguments, seed) for seed in arguments.seeds]
    print("\nin order" if all(good) else "\nNOT in order")
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
