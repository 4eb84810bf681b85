#!/usr/bin/env python3
"""A candidate service that misbehaves on request: the other end of the contract for tests of the uploader.

fault_service.py is what it remembers; here is how it speaks, and how it fails.

usage: fault_server.py [--seed N] [--rate SHARE]: serves until it is killed; prints its address.
"""
import argparse
import base64
import collections
import http.server
import io
import json
import os
import pathlib
import random
import re
import socket
import struct
import sys
import threading

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from fault_service import Problem, Service  # noqa: E402

TOKEN = "a-token-for-tests-only"
KINDS = ("error_500", "busy_429", "lost_reply", "twice", "wrong_offset", "garbage", "oversized", "forget", "cut", "mangled")


class Faults:
    """Which request goes wrong, and how. Seeded; `most` of them in all, so that every run comes to an end."""

    def __init__(self, seed=0, rate=0.0, kinds=KINDS, most=10_000, cuts=(), retry_after=1):
        self.random, self.rate, self.kinds, self.left = random.Random(seed), rate, tuple(kinds), most
        self.cuts = sorted(cuts)  # body bytes of all parts after which the line breaks
        self.retry_after = retry_after
        self.body_bytes = 0
        self.done = collections.Counter()

    def next(self):
        if self.left <= 0 or self.random.random() >= self.rate:
            return None
        self.left -= 1
        kind = self.random.choice(self.kinds)
        self.done[kind] += 1
        return kind

    def break_at(self, size):
        """After how many bytes of this body the line breaks; None when it does not."""
        if self.cuts and self.body_bytes + size >= self.cuts[0]:
            at = self.cuts.pop(0) - self.body_bytes
            self.done["cut"] += 1
            return max(at, 0)
        return None


class CountingRaw(socket.SocketIO):
    def __init__(self, connection, service):
        super().__init__(connection, "r")
        self.service = service

    def readinto(self, buffer):
        count = super().readinto(buffer)
        with self.service.lock:
            self.service.received += count or 0
        return count


class Broken(Exception):
    """The line is cut: nothing more is said."""


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    timeout = 60

    def setup(self):
        super().setup()
        self.rfile = io.BufferedReader(CountingRaw(self.connection, self.server.service), 1 << 16)

    def log_message(self, *args):
        pass

    def do_GET(self): self.serve()
    def do_POST(self): self.serve()
    def do_HEAD(self): self.serve()
    def do_PATCH(self): self.serve()

    def serve(self):
        service, faults = self.server.service, self.server.faults
        try:
            with service.lock:
                service.requests[self.command] += 1
                fault = faults.next()
            body, whole = self.read_body(fault)
            self.request_body = body
            if not whole:
                self.call(body, whole)
                raise Broken
            if fault == "error_500":
                return self.answer(500, {"Content-Type": "text/plain"}, b"out of order")
            if fault == "busy_429":
                return self.reply_problem(Problem(429, "too-many-requests", "later", {"Retry-After": str(faults.retry_after)}))
            if fault == "forget" and (match := re.match(r"/v1/uploads/([^/]+)", self.path)):
                with service.lock:
                    service.forget(match[1])
            if fault == "mangled" and self.command == "PATCH":
                body = bytes([body[0] ^ 1]) + body[1:]
            status, headers, reply = self.call(body)
            if fault == "twice":
                status, headers, reply = self.call(body)
            if fault == "lost_reply":
                raise Broken
            if fault == "wrong_offset" and "Upload-Offset" in headers:
                headers["Upload-Offset"] = str(faults.random.choice([0, 1, int(headers["Upload-Offset"]) + 4097, 1 << 40]))
            if fault == "garbage":
                reply = faults.random.choice([b"<html>hello</html>", b"{", b"[]", b'{"upload_id": 7}', os.urandom(200)])
                headers = {"Content-Type": "application/json"}
            if fault == "oversized":
                reply = b" " * (5 << 20)
            self.answer(status, headers, reply)
        except Broken:
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset, not an end
            self.close_connection = True
        except (ConnectionError, TimeoutError):
            self.close_connection = True

    def read_body(self, fault):
        size, faults, service = int(self.headers.get("Content-Length") or 0), self.server.faults, self.server.service
        stop = None
        if self.command == "PATCH":
            with service.lock:
                stop = faults.break_at(size)
                if fault == "cut" and stop is None:
                    stop = faults.random.randrange(size)
                faults.body_bytes += size if stop is None else min(stop, size)
        body = self.rfile.read(size if stop is None else min(stop, size))
        if stop is None and len(body) < size:
            raise ConnectionError
        return body, stop is None

    def call(self, body, whole=True):
        service = self.server.service
        try:
            with service.lock:
                return self.route(service, body, whole)
        except Problem as problem:
            return self.problem(problem)
        except (KeyError, TypeError, ValueError) as error:
            return self.problem(Problem(400, "bad-request", repr(error)[:200]))

    def route(self, service, body, whole):
        if (self.command, self.path) == ("GET", "/v1/health"):
            return self.json(200, {"status": "pass", "reason": ""})
        if self.headers.get("Authorization") != "Bearer " + TOKEN:
            raise Problem(401, "unauthorized", "no token or a wrong one", {"WWW-Authenticate": "Bearer"})
        if (self.command, self.path) == ("POST", "/v1/uploads"):
            status, document = service.announce(self.headers.get("Idempotency-Key"), body)
            return self.json(status, document)
        if (self.command, self.path) == ("GET", "/v1/reason-codes"):
            return self.json(200, {"version": 1, "codes": []})
        match = re.fullmatch(r"/v1/uploads/([A-Za-z0-9_-]{8,64})(/complete|/packs/([0-9a-f]{64}))?", self.path)
        if not match:
            raise Problem(404, "not-found", "no such path")
        upload, rest, sha = match.groups()
        if self.command == "GET" and not rest:
            return self.json(200, service.status(upload))
        if self.command == "POST" and rest == "/complete":
            return self.json(202, service.complete(upload))
        if self.command == "HEAD" and sha:
            offset, length = service.offset(upload, sha)
            return 200, {"Upload-Offset": str(offset), "Upload-Length": str(length)}, b""
        if self.command == "PATCH" and sha:
            digest = re.fullmatch(r"sha-256=:([A-Za-z0-9+/]{43}=):", self.headers.get("Content-Digest", ""))
            if not digest:
                raise Problem(400, "bad-request", "no Content-Digest")
            reached = service.part(upload, sha, int(self.headers["Upload-Offset"]), int(self.headers["Upload-Length"]),
                                   base64.b64decode(digest[1]), body, whole)
            return 204, {"Upload-Offset": str(reached)}, b""
        raise Problem(405, "method-not-allowed", self.command)

    @staticmethod
    def json(status, document):
        return status, {"Content-Type": "application/json"}, json.dumps(document).encode()

    @staticmethod
    def problem(problem):
        document = {"type": "urn:nadir:problem:" + problem.kind, "title": problem.kind, "status": problem.status,
                    "detail": problem.detail, **problem.more}
        return problem.status, {"Content-Type": "application/problem+json", **problem.headers}, json.dumps(document).encode()

    def reply_problem(self, problem):
        self.answer(*self.problem(problem))

    def answer(self, status, headers, reply):
        if self.server.watch:
            self.server.watch(self.command, self.path, self.headers, self.request_body, status, headers, reply)
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name, value)
        if status != 204:
            self.send_header("Content-Length", str(len(reply)))
        self.end_headers()
        if self.command != "HEAD" and status != 204:
            self.wfile.write(reply)


class QuietServer(http.server.ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request, client_address):
        """A client that was killed resets its connection: no news."""


class FaultServer:
    # watch: called with every request and its answer.
    def __init__(self, service=None, faults=None, port=0, watch=None):
        self.http = QuietServer(("127.0.0.1", port), Handler)
        self.http.service, self.http.faults, self.http.watch = service or Service(), faults or Faults(), watch
        self.url = f"http://127.0.0.1:{self.http.server_address[1]}"
        threading.Thread(target=self.http.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()

    @property
    def service(self):
        return self.http.service

    @property
    def faults(self):
        return self.http.faults

    def stop(self):
        self.http.shutdown()
        self.http.server_close()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rate", type=float, default=0.0)
    arguments = parser.parse_args()
    server = FaultServer(faults=Faults(arguments.seed, arguments.rate))
    print(server.url, flush=True)
    threading.Event().wait()


if __name__ == "__main__":
    main()
