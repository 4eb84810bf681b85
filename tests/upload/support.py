"""What the tests of `nadir sync` share: a flight's candidates, the programs, and the books of both sides compared."""
import os
import pathlib
import sqlite3
import subprocess

from fault_server import TOKEN

# In memory where there is such a place: the outbox syncs with every step, and kills do not need a disk.
TEMPORARY = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
FINAL = {"ACCEPTED", "REJECTED", "DUPLICATE", "REFUSED"}


class Flight:
    """A key and a store of candidate tiles in a folder of its own."""

    def __init__(self, folder, make_candidates, tiles, mean_bytes, seed=1, clean=True):
        self.key = pathlib.Path(folder) / "mini-07.key.pem"
        self.candidates = pathlib.Path(folder) / "candidates"
        subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", self.key], check=True, capture_output=True)
        self.key.chmod(0o600)
        subprocess.run([make_candidates, self.candidates, self.key, str(tiles), str(mean_bytes), str(seed)]
                       + ([] if clean else ["unclean"]), check=True)


def sync(program, *arguments, kill_at=None, kill_count=None, seed=1, token=TOKEN, variables=(), **more):
    """Runs one command of `nadir sync`; returns the finished process."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NADIR_")} | dict(variables)
    environment["NADIR_TEST_SEED"] = str(seed)
    if token is not None:
        environment["NADIR_SYNC_TOKEN"] = token
    if kill_at is not None:
        environment["NADIR_TEST_KILL_AT"] = kill_at
    if kill_count is not None:
        environment["NADIR_TEST_KILL_COUNT"] = str(kill_count)
    return subprocess.run([program, "sync", *map(str, arguments)], env=environment, capture_output=True, text=True,
                          stdin=subprocess.DEVNULL, **more)


def push(program, outbox, url, **more):
    return sync(program, "push", outbox, "--to", url, "--timeout-s", "86400", "--json", **more)


def tiles(outbox):
    """The sidecar's digest to (state, code) of every tile."""
    with sqlite3.connect(f"file:{outbox}/outbox.sqlite?mode=ro", uri=True) as database:
        return {row[0].hex(): (row[1], row[2]) for row in database.execute("SELECT candidate, state, code FROM tile")}


def discrepancies(outbox, service, count):
    """The outbox compared with the service: nothing lost, nothing twice."""
    found, ours = [], tiles(outbox)
    if len(ours) != count:
        found.append(f"{len(ours)} tiles in the outbox, {count} were made")
    for name, (state, code) in ours.items():
        if state not in FINAL:
            found.append(f"{name}: {state}")
        elif state in ("ACCEPTED", "DUPLICATE") and service.accepted[name] != 1:
            found.append(f"{name}: {state}, but the service counts it {service.accepted[name]} times")
        elif state in ("REJECTED", "REFUSED") and (service.accepted[name] or not code):
            found.append(f"{name}: {state} {code}, but the service accepted it")
    lost = set(service.accepted) - set(ours)
    return found + [f"{name}: accepted, but not ours" for name in lost]
