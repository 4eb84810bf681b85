"""A real PostgreSQL server with PostGIS for tests: in a folder of its own, a Unix socket, no network, an unprivileged user,
stopped at the end. Whoever imports this is skipped (exit code 77) where there is none.
"""
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

PORT = "54329"


def find_server():
    """The folder of PostgreSQL's programs that has PostGIS beside it, or the end of this test as skipped."""
    for binaries in sorted(pathlib.Path("/usr/lib/postgresql").glob("*/bin"), reverse=True):
        extension = pathlib.Path("/usr/share/postgresql") / binaries.parent.name / "extension" / "postgis.control"
        if (binaries / "initdb").exists() and extension.exists():
            return binaries
    print("NOT TESTED: catalogues in PostGIS. PostgreSQL or PostGIS is not installed (packages_test in "
          ".ci/packages.sh)", file=sys.stderr)
    sys.exit(77)


BINARIES = find_server()


class Server:
    """A cluster in a folder; the server dies with this process whatever happens."""

    def __init__(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="nadir-pg.", dir="/tmp"))
        self.process = None
        self.as_user = []
        if os.getuid() == 0:  # PostgreSQL refuses to run as root
            shutil.chown(self.folder, "nobody", "nogroup")
            self.as_user = ["setpriv", "--reuid=nobody", "--regid=nogroup", "--clear-groups", "--pdeathsig=TERM"]
        self.env = {**os.environ, "PGHOST": str(self.folder), "PGPORT": PORT, "PGUSER": "fleet", "PGPASSFILE": str(self.folder / "none"),
                    "PGCONNECT_TIMEOUT": "60", "LC_ALL": "C"}
        self.run("initdb", "-D", "data", "-U", "fleet", "-A", "trust", "--no-sync", "-E", "UTF8", "--locale=C")
        hba = self.folder / "data" / "pg_hba.conf"
        hba.write_text("local all guest scram-sha-256\nlocal all all trust\n")

    def run(self, program, *args):
        result = subprocess.run([*self.as_user, str(BINARIES / program), *args], cwd=self.folder, env=self.env, text=True,
                                stdin=subprocess.DEVNULL, capture_output=True, timeout=120)
        if result.returncode != 0:
            raise RuntimeError(f"{program}: {result.stdout}{result.stderr}")

    def start(self, durable=False):
        """durable: what it has committed survives a power cut, and costs what that costs."""
        with open(self.folder / "log", "a") as log:
            self.process = subprocess.Popen(
                [*self.as_user, str(BINARIES / "postgres"), "-D", "data", "-p", PORT, "-c", "listen_addresses=",
                 "-c", f"unix_socket_directories={self.folder}", "-c", f"fsync={'on' if durable else 'off'}"],
                cwd=self.folder, env=self.env, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        for _ in range(1200):
            ready = subprocess.run([str(BINARIES / "pg_isready"), "-q"], env=self.env, check=False)
            if ready.returncode == 0:
                return
            if self.process.poll() is not None:
                raise RuntimeError((self.folder / "log").read_text())
            time.sleep(0.05)
        raise RuntimeError("the server does not come up: " + (self.folder / "log").read_text())

    def stop(self):
        """At once, as if it had crashed."""
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(signal.SIGQUIT)
            self.process.wait(timeout=60)

    def remove(self):
        self.stop()
        shutil.rmtree(self.folder, True)

    def psql(self, database, sql):
        result = subprocess.run([str(BINARIES / "psql"), "-X", "-At", "-v", "ON_ERROR_STOP=1", "-d", database, "-c", sql],
                                env=self.env, text=True, stdin=subprocess.DEVNULL, capture_output=True, timeout=120)
        if result.returncode != 0:
            raise RuntimeError(f"{sql}: {result.stderr}")
        return result.stdout.strip()
