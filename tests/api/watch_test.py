#!/usr/bin/env python3
"""nadir watch as a user calls it: once, as lines, as JSON, on a terminal, and without a service.

usage: watch_test.py TEST_API_SERVER NADIR
"""
import json
import os
import pathlib
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from scripted_service import ScriptedService  # noqa: E402

SERVER, NADIR = sys.argv[1], sys.argv[2]


class Watch(unittest.TestCase):
    def serve(self, *options):
        service = ScriptedService(SERVER, *options)
        self.addCleanup(service.stop)
        return service

    def watch(self, *args):
        return subprocess.run([NADIR, "watch", *map(str, args)], capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=120)

    def watching(self, *args, **options):
        process = subprocess.Popen([NADIR, "watch", *args], stdin=subprocess.DEVNULL, **options)
        self.addCleanup(lambda: process.poll() is None and process.kill())
        return process

    def test_once(self):
        result = self.watch(self.serve().url, "--once")
        self.assertEqual((0, ""), (result.returncode, result.stderr), result.stdout)
        for word in ("NORMAL", "anchored to the map", "2.8 m", "protection  18.2 m\n", "spoofed: 312 m from vision", "connected, signed", "critical"):
            self.assertIn(word, result.stdout)
        self.assertNotIn("\x1b", result.stdout)

    def test_once_as_json(self):
        service = self.serve()
        result = self.watch(service.url, "--once", "--json")
        self.assertEqual("normal", json.loads(result.stdout)["state"])

    def test_no_position_is_1(self):
        service = self.serve()
        service.command("no_fix")
        while self.watch(service.url, "--once").returncode == 0:
            pass
        result = self.watch(service.url, "--once")
        self.assertEqual(1, result.returncode)
        self.assertIn("NO FIX", result.stdout)

    def test_an_autopilot_that_is_not_connected_is_shown_with_the_reason(self):
        service = self.serve()
        service.command("awaiting_autopilot")
        while "AWAITING AUTOPILOT" not in (result := self.watch(service.url, "--once")).stdout:
            pass
        self.assertIn("not connected (serial:/dev/ttyAMA0:921600: Device or resource busy), signed", result.stdout)

    def test_lines_for_a_log(self):
        service = self.serve()
        process = self.watching(service.url, "--interval-s", "0.1", stdout=subprocess.PIPE, text=True)
        first = process.stdout.readline()
        self.assertTrue(first.startswith("event  "), first)
        service.command("degraded")
        before = first
        for line in process.stdout:
            if line.startswith("degraded, dead_reckoned, sigma 38.0 m, protection level 247.0 m (NOT USABLE)"):
                break
            before = line
        self.assertRegex(before, r"^event +[0-9]+ s  warning   degraded: camera sees cloud")
        process.send_signal(signal.SIGINT)
        process.stdout.close()
        self.assertEqual(0, process.wait(timeout=60))

    def test_continues_without_the_service(self):
        service = self.serve()
        process = self.watching(service.url, "--interval-s", "0.1", "--json", stdout=subprocess.PIPE, text=True)
        self.assertEqual("normal", json.loads(process.stdout.readline())["state"])
        service.stop()
        for line in process.stdout:
            if json.loads(line).get("contact") is False:
                break
        process.terminate()
        process.stdout.close()
        self.assertEqual(0, process.wait(timeout=60))

    def test_a_terminal_is_restored(self):
        service = self.serve()
        ours, theirs = pty.openpty()
        process = self.watching(service.url, "--interval-s", "0.1", stdout=theirs)
        os.close(theirs)
        shown, asked = b"", False
        while True:
            if not select.select([ours], [], [], 60)[0]:
                self.fail(f"nothing comes: {shown!r}")
            try:
                piece = os.read(ours, 65536)
            except OSError:  # the terminal's other side is closed
                break
            shown += piece
            if shown.count(b"\x1b[H") >= 2 and not asked:
                asked = True
                process.send_signal(signal.SIGINT)
        self.assertEqual(0, process.wait(timeout=60))
        self.assertTrue(shown.startswith(b"\x1b[?1049h"))
        self.assertTrue(shown.endswith(b"\x1b[?25h\x1b[?1049l"))
        self.assertIn(b"NORMAL", shown)
        os.close(ours)

    def test_ages_alarms_and_repeats(self):
        service = self.serve()
        service.command("corrupt")
        service.command("flap")
        service.command("unsigned")
        service.command("degraded")
        while "DEGRADED" not in (shown := self.watch(service.url, "--once").stdout):
            pass
        self.assertRegex(shown, r"alarms\n +\d+ s +critical +artifact.hash: tile 17/70000/45000")
        self.assertIn("no frame for 0.45 s (x 5)", shown)
        self.assertIn("1 CORRUPT TILE", shown)
        self.assertIn("247.0 m: NOT USABLE, alert limit 100 m", shown)
        self.assertIn("NOT SIGNED", shown)
        age = lambda text: float(re.search(r"anchor age +([0-9.]+) s", text)[1])
        service.command("stall")
        first = self.watch(service.url, "--once").stdout
        while "STALE" not in (later := self.watch(service.url, "--once").stdout):
            pass
        self.assertGreater(age(later), age(first))
        self.assertRegex(later, r"frames +NONE for [0-9]+ s")
        self.assertRegex(later, r"heading +[0-9]{3}°")

    def test_without_contact_ages_go_on(self):
        service = self.serve()
        ours, theirs = pty.openpty()
        process = self.watching(service.url, "--interval-s", "0.1", stdout=theirs)
        os.close(theirs)
        shown, stopped = b"", False
        ages = lambda: [float(age) for age in re.findall(rb"anchor age +([0-9.]+) s", shown.split(b"NO CONTACT", 1)[-1])]
        while not (b"NO CONTACT" in shown and len(ages()) > 3 and ages()[-1] > ages()[0] + .5):
            if not select.select([ours], [], [], 60)[0]:
                self.fail(f"nothing comes: {shown!r}")
            shown += os.read(ours, 65536)
            if b"anchor age" in shown and not stopped:
                stopped = True
                service.stop()
        process.send_signal(signal.SIGINT)
        while True:
            try:
                os.read(ours, 65536)
            except OSError:
                break
        self.assertEqual(0, process.wait(timeout=60))
        os.close(ours)

    def test_tokens(self):
        with tempfile.TemporaryDirectory() as folder:
            token = pathlib.Path(folder) / "token"
            token.touch(0o600)
            token.write_text("a-secret-of-the-crew\n")
            service = self.serve("--token-file", token)
            refused = self.watch(service.url, "--once")
            self.assertEqual(2, refused.returncode)
            self.assertIn("--token-file", refused.stderr)
            self.assertEqual(0, self.watch(service.url, "--once", "--token-file", token).returncode)
            token.chmod(0o644)
            self.assertIn("chmod 600", self.watch(service.url, "--once", "--token-file", token).stderr)

    def test_no_server_responds(self):
        with socket.socket() as taken:  # bound, but not listening
            taken.bind(("127.0.0.1", 0))
            result = self.watch(f"http://127.0.0.1:{taken.getsockname()[1]}", "--once")
        self.assertEqual(2, result.returncode)
        self.assertIn("does not answer", result.stderr)

    def test_another_server_responds(self):
        for answer in (b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}", b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\n\r\n[[[[[", b"SSH-2.0-x\r\n", b"",
                       b"HTTP/1.1 500 \x1b[2J\r\nContent-Length: 4\r\n\r\n\x1b[2J", b"HTTP/1.1 200 OK\r\nContent-Length: 99999999999\r\n\r\n"):
            with self.subTest(answer), socket.socket() as other:
                other.bind(("127.0.0.1", 0))
                other.listen()

                def answer_one():
                    connection, _ = other.accept()
                    connection.recv(4096)
                    connection.sendall(answer)
                    connection.close()

                thread = threading.Thread(target=answer_one)
                thread.start()
                result = self.watch(f"http://127.0.0.1:{other.getsockname()[1]}", "--once")
                thread.join()
                self.assertEqual(2, result.returncode, result.stdout)
                self.assertNotIn("unexpected:", result.stderr)
                self.assertNotIn("\x1b", result.stderr)

    def test_wrong_urls(self):
        for url in ("ftp://localhost", "http://", "http://a b", "localhost:8750", "http://h:x", "http://h/\r\nX: y"):
            result = self.watch(url, "--once")
            self.assertEqual(2, result.returncode, url)
            self.assertIn("http://HOST:PORT", result.stderr)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]], verbosity=2)
