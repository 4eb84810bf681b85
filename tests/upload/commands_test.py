#!/usr/bin/env python3
"""`nadir sync` as its user calls it: exit codes, messages, secrets, certificates.

usage: commands_test.py TEST_KILLED_SYNC TEST_MAKE_CANDIDATES NADIR
"""
import http.server
import json
import os
import pathlib
import signal
import sqlite3
import ssl
import subprocess
import sys
import tempfile
import threading
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from fault_server import TOKEN, FaultServer, Faults, Handler, QuietServer  # noqa: E402
from fault_service import Service  # noqa: E402
from support import TEMPORARY, Flight, discrepancies, sync, tiles  # noqa: E402

KILLED, MAKE, NADIR = sys.argv[1:4]
COUNT = 12


class Commands(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(dir=TEMPORARY)
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.flight = Flight(self.folder, MAKE, COUNT, 8_000)
        self.outbox = self.folder / "outbox"
        self.server = FaultServer(Service(at_once=True))
        self.addCleanup(self.server.stop)

    def stage(self, *more):
        return sync(NADIR, "stage", self.flight.candidates, "--outbox", self.outbox, "--key", self.flight.key, *more)

    def push(self, *more, **environment):
        return sync(NADIR, "push", self.outbox, "--to", self.server.url, *more, **environment)

    def ends(self, code, result, *words):
        self.assertEqual(code, result.returncode, result.stdout + result.stderr)
        for word in words:
            self.assertIn(word, result.stdout + result.stderr)
        self.assertNotIn(TOKEN, result.stdout + result.stderr)
        return result

    def test_from_staging_to_verdict(self):
        self.ends(0, self.stage("--dry-run"), f"{COUNT} tiles could be staged")
        self.assertFalse(self.outbox.exists())
        self.ends(0, self.stage(), f"staged {COUNT} tiles")
        self.ends(0, self.stage(), "staged 0 tiles", f"{COUNT} already staged")
        self.ends(1, sync(NADIR, "status", self.outbox), "SEALED")
        self.ends(0, self.push("--dry-run"), f"{COUNT} tiles would be sent")
        self.assertEqual(0, self.server.service.received)
        result = self.ends(0, self.push("--json"))
        self.assertEqual("", result.stderr)
        self.assertEqual(COUNT, json.loads(result.stdout)["accepted"])
        self.assertEqual([], discrepancies(self.outbox, self.server.service, COUNT))
        status = json.loads(self.ends(0, sync(NADIR, "status", self.outbox, "--json")).stdout)
        self.assertEqual(COUNT, status["states"]["ACCEPTED"]["tiles"])
        self.assertEqual([], status["batches"])
        self.ends(0, self.push(), "accepted 0")
        self.ends(0, self.stage(), "staged 0 tiles")

    def test_a_flight_without_a_clean_end_is_rejected(self):
        with tempfile.TemporaryDirectory(dir=TEMPORARY) as folder:
            self.flight = Flight(folder, MAKE, COUNT, 1_000, clean=False)
            self.ends(1, self.stage(), "flight.unfinished")
            self.assertFalse(self.outbox.exists())
            self.ends(0, self.stage("--force"), "flight.unfinished", f"staged {COUNT}")

    def test_tiles_that_were_changed_are_left_out(self):
        with sqlite3.connect(self.flight.candidates / "tiles.mbtiles") as database:
            database.execute("UPDATE tiles SET tile_data = x'ffd8ff00' WHERE rowid = (SELECT min(rowid) FROM tiles)")
        self.ends(1, self.stage(), "candidate.damaged", f"staged {COUNT - 1}")

    def test_rejected_tiles_are_reported_and_retried(self):
        service = self.server.service
        service.judge = lambda sidecar: "quota"
        self.ends(0, self.stage())
        self.ends(1, self.push(), f"rejected {COUNT}")
        self.ends(0, sync(NADIR, "status", self.outbox, "--failed", 3), "quota", "REJECTED")
        self.ends(2, sync(NADIR, "retry", self.outbox, "--code", "quota"), "--key")
        self.ends(2, sync(NADIR, "retry", self.outbox, "--code", "qouta", "--key", self.flight.key), "unknown reason")
        service.judge = lambda sidecar: None
        self.ends(0, sync(NADIR, "retry", self.outbox, "--code", "quota", "--key", self.flight.key, seed=2), f"{COUNT} tiles")
        self.ends(0, self.push(), f"accepted {COUNT}")

    def test_images_are_deleted_only_after_verdict_and_retention(self):
        self.ends(0, self.stage())
        self.ends(0, sync(NADIR, "prune", self.outbox, "--keep-days", 0), "0 tiles")
        self.ends(0, self.push())
        self.ends(0, sync(NADIR, "prune", self.outbox), "0 tiles")
        self.ends(0, sync(NADIR, "prune", self.outbox, "--keep-days", 0, "--dry-run"), f"{COUNT} tiles")
        size = (self.outbox / "outbox.sqlite").stat().st_size
        self.ends(0, sync(NADIR, "prune", self.outbox, "--keep-days", 0), f"{COUNT} tiles")
        self.assertLess((self.outbox / "outbox.sqlite").stat().st_size, size)
        self.ends(0, self.stage(), "staged 0 tiles")

    def test_the_outbox_is_locked(self):
        self.ends(0, self.stage())
        database = sqlite3.connect(self.outbox / "outbox.sqlite")
        self.addCleanup(database.close)
        for statement in ("DELETE FROM blob", "UPDATE blob SET bytes = x'00'", "DELETE FROM tile",
                          "UPDATE tile SET state = 'ACCEPTED'", "UPDATE tile SET state = 'STAGED'"):
            with self.assertRaises(sqlite3.IntegrityError, msg=statement):
                database.execute(statement)

    def test_the_token(self):
        self.ends(0, self.stage())
        self.ends(2, self.push(token=None), "NADIR_SYNC_TOKEN")
        self.ends(2, self.push(token="short"), "not a valid token")
        self.ends(2, self.push(token="another-token-than-the-right-one"), "does not accept the token")
        self.assertEqual({"SEALED"}, {state for state, _ in tiles(self.outbox).values()})
        file = self.folder / "token"
        file.write_text(TOKEN + "\n")
        file.chmod(0o644)
        self.ends(2, self.push("--token-file", file, token=None), "readable by other users")
        file.chmod(0o600)
        self.ends(0, self.push("--token-file", file, token=None))

    def test_addresses(self):
        self.ends(0, self.stage())
        for address in ("http://tiles.example.org", "ftp://localhost", "localhost:8760", "https://user:word@example.org",
                        "https://example.org/?key=1", "file:///etc/passwd"):
            self.ends(2, sync(NADIR, "push", self.outbox, "--to", address), "address")
        result = sync(NADIR, "push", self.outbox, "--to", "http://127.0.0.1:1", "--timeout-s", 0)
        self.ends(2, result, "not complete", "connect")

    def test_the_token_never_reaches_a_proxy_unencrypted(self):
        received = []

        class Proxy(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                received.append(self.headers["Authorization"])
                self.send_error(502)

            def log_message(self, *args):
                pass
        proxy = http.server.HTTPServer(("127.0.0.1", 0), Proxy)
        self.addCleanup(proxy.server_close)
        self.addCleanup(proxy.shutdown)
        threading.Thread(target=proxy.serve_forever, daemon=True).start()
        there = {name: f"http://127.0.0.1:{proxy.server_address[1]}" for name in ("http_proxy", "all_proxy", "ALL_PROXY")}
        self.ends(0, self.stage())
        self.ends(0, self.push("--timeout-s", 0, variables=there | {"no_proxy": "", "NO_PROXY": ""}), f"accepted {COUNT}")
        self.assertEqual([], received)

    def test_a_key_that_the_service_rejects(self):
        def key(name):
            path = self.folder / f"{name}.key.pem"
            subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", path], check=True, capture_output=True)
            path.chmod(0o600)
            return path

        def public(path):
            subprocess.run(["openssl", "pkey", "-in", path, "-pubout", "-out", f"{path}.pub"], check=True)
            return f"{path}.pub"
        root, own = self.folder / "root.json", key("root")
        subprocess.run([NADIR, "keys", "root", "--root-key", own, "--package-signer", public(own), "--tile-signer",
                        f"mini-07={public(self.flight.key)}", "--expires", "2099-01-01", "--out", root], check=True,
                       capture_output=True)
        tile_key, self.flight.key = self.flight.key, key("untrusted")
        self.ends(2, self.stage("--trust", root), "does not give this tile key")
        self.assertEqual({}, tiles(self.outbox))
        self.flight.key = tile_key
        self.ends(0, self.stage("--trust", root), f"staged {COUNT} tiles")

    def test_a_redirect_is_not_followed(self):
        class Elsewhere(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                self.send_response(307)
                self.send_header("Location", url + "/v1/uploads")
                self.send_header("Content-Length", "0")
                self.end_headers()

            def log_message(self, *args):
                pass
        url, other = self.server.url, http.server.HTTPServer(("127.0.0.1", 0), Elsewhere)
        self.addCleanup(other.server_close)
        self.addCleanup(other.shutdown)
        threading.Thread(target=other.serve_forever, daemon=True).start()
        self.ends(0, self.stage())
        result = sync(NADIR, "push", self.outbox, "--to", f"http://127.0.0.1:{other.server_address[1]}")
        self.ends(2, result, "not the address of a candidate service")
        self.assertEqual(0, self.server.service.received)

    def test_certificates_are_verified(self):
        self.ends(0, self.stage())
        certificate, key = self.folder / "certificate.pem", self.folder / "tls.key.pem"
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                        "-keyout", key, "-out", certificate, "-days", "2", "-subj", "/CN=localhost",
                        "-addext", "subjectAltName=DNS:localhost"], check=True, capture_output=True)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate, key)
        secure = QuietServer(("127.0.0.1", 0), Secure)
        secure.service, secure.faults, secure.watch = Service(at_once=True), Faults(), None
        secure.socket = context.wrap_socket(secure.socket, server_side=True)
        self.addCleanup(secure.server_close)
        self.addCleanup(secure.shutdown)
        threading.Thread(target=secure.serve_forever, daemon=True).start()
        port = secure.server_address[1]
        self.ends(2, sync(NADIR, "push", self.outbox, "--to", f"https://localhost:{port}", "--timeout-s", 0), "certificate")
        wrong_name = sync(NADIR, "push", self.outbox, "--to", f"https://127.0.0.1:{port}", "--ca", certificate, "--timeout-s", 0)
        self.ends(2, wrong_name, "not complete")
        self.assertEqual(0, len(secure.service.uploads))
        self.ends(0, sync(NADIR, "push", self.outbox, "--to", f"https://localhost:{port}", "--ca", certificate), f"accepted {COUNT}")

    def test_one_at_a_time(self):
        self.ends(0, self.stage())
        import fcntl
        with open(self.outbox / "lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            self.ends(2, self.push(), "another process is using this outbox")
            self.ends(1, sync(NADIR, "status", self.outbox), "SEALED")

    def test_a_folder_that_is_not_an_outbox(self):
        self.ends(2, self.push(), "there is no outbox")
        self.outbox.mkdir()
        (self.outbox / "outbox.sqlite").write_text("hello, this is no database at all")
        for result in (self.push(), sync(NADIR, "status", self.outbox), self.stage()):
            self.ends(2, result)
        (self.outbox / "outbox.sqlite").unlink()
        sqlite3.connect(self.outbox / "outbox.sqlite").execute("CREATE TABLE tile (a)").connection.commit()
        self.ends(2, self.push(), "not an outbox")
        self.ends(2, sync(NADIR, "stage", self.folder, "--outbox", self.outbox, "--key", self.flight.key))

    def test_an_interrupt_leaves_a_consistent_state(self):
        self.ends(0, self.stage())
        held, go_on = threading.Event(), threading.Event()
        original = Service.announce

        def announce(service, *arguments):
            held.set()
            go_on.wait(60)
            return original(service, *arguments)
        self.server.service.announce = announce.__get__(self.server.service)
        process = subprocess.Popen([NADIR, "sync", "push", self.outbox, "--to", self.server.url],
                                   env={**os.environ, "NADIR_SYNC_TOKEN": TOKEN}, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.assertTrue(held.wait(60))
        process.send_signal(signal.SIGINT)
        self.assertEqual(130, process.wait(60))
        process.communicate()
        go_on.set()
        self.ends(0, self.push(), f"accepted {COUNT}")
        self.assertEqual([], discrepancies(self.outbox, self.server.service, COUNT))


class Secure(Handler):
    """Behind TLS: the socket's own reader, because bytes are not counted here."""

    def setup(self):
        http.server.BaseHTTPRequestHandler.setup(self)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
