#!/usr/bin/env python3
"""A candidate service that misbehaves as it is told to: the other end of the contract for tests of the uploader.

It keeps schemas/candidates.openapi.yaml, reads packs by itself, and counts what it accepts, so that a tile that is lost
or counted twice shows. It checks no signatures: nadir-candidates does.

usage: fault_server.py [--seed N] [--rate SHARE]: serves until it is killed; prints its address.
"""
import argparse
import base64
import collections
import hashlib
import http.server
import io
import json
import os
import random
import re
import socket
import struct
import threading

TOKEN = "a-token-for-tests-only"
KINDS = ("error_500", "busy_429", "lost_reply", "twice", "wrong_offset", "garbage", "oversized", "forget", "cut", "mangled")
MAX_PACK = 8 << 20


class Problem(Exception):
    def __init__(self, status, kind, detail, headers=None, **more):
        super().__init__(detail)
        self.status, self.kind, self.detail, self.headers, self.more = status, kind, detail, headers or {}, more


def canonical(document):
    return json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()


def read_pack(data):
    """Digest to bytes, by the words of the contract alone."""
    if data[:8] != b"NADIRPK1":
        raise ValueError("magic")
    (count,) = struct.unpack_from(">I", data, 8)
    at, tiles = 12 + 36 * count, {}
    for i in range(count):
        digest, size = struct.unpack_from(">32sI", data, 12 + 36 * i)
        tile = data[at:at + size]
        at += size
        if len(tile) != size or hashlib.sha256(tile).digest() != digest or digest.hex() in tiles:
            raise ValueError(f"tile {i}")
        tiles[digest.hex()] = bytes(tile)
    if at != len(data):
        raise ValueError("length")
    return tiles


class Service:
    """What a service remembers, and the calls of the contract on it."""

    def __init__(self, part_max=MAX_PACK, keep_partial=False, at_once=False, judge=None, refuse=None):
        self.lock = threading.RLock()
        self.part_max, self.keep_partial = part_max, keep_partial
        self.at_once = at_once  # all verdicts with the first question
        self.judge = judge or (lambda sidecar: None)    # a reason code, or None
        self.refuse = refuse or (lambda sidecar: None)
        self.uploads, self.by_key, self.packs, self.blobs = {}, {}, {}, {}
        self.accepted = collections.Counter()  # by the sidecar's digest: how often it counted
        self.rejected = collections.Counter()
        self.received = 0  # bytes from sockets
        self.requests = collections.Counter()
        self.packs_taken = 0

    def announce(self, key, body):
        document = json.loads(body)
        batch = document["signed"]
        if set(document) != {"signed", "signatures"} or batch["schema"] != "nadir.batch/1":
            raise Problem(422, "batch-invalid", "not a batch")
        if key != batch["batch"]:
            raise Problem(422, "batch-invalid", "the Idempotency-Key is not the batch's id")
        digest = hashlib.sha256(body).hexdigest()
        if key in self.by_key:
            upload = self.uploads[self.by_key[key]]
            if upload["body"] != digest:
                raise Problem(422, "key-reused", "this key belongs to another body")
            return 200, self.announcement(upload)
        tiles = {}
        for tile in batch["tiles"]:
            sidecar = tile["sidecar"]
            code = self.refuse(sidecar)
            tiles[sidecar["sha256"]] = {"sidecar": sidecar, "name": hashlib.sha256(canonical(sidecar)).hexdigest(),
                                        "verdict": "rejected" if code else "pending", "code": code, "refused": bool(code)}
        if len(tiles) != len(batch["tiles"]) or len(tiles) > 2000 or len(body) > 4 << 20:
            raise Problem(422, "batch-invalid", "a tile twice, or too many")
        upload = {"id": f"upload-{len(self.uploads):06d}", "key": key, "body": digest, "tiles": tiles, "state": "open",
                  "polls": 0}
        self.uploads[upload["id"]] = upload
        self.by_key[key] = upload["id"]
        return 201, self.announcement(upload)

    def announcement(self, upload):
        wanted = [sha for sha, tile in upload["tiles"].items() if not tile["refused"]]
        return {"upload_id": upload["id"], "missing": [s for s in wanted if s not in self.blobs],
                "known": [s for s in wanted if s in self.blobs],
                "refused": [{"sha256": s, "code": t["code"], "detail": "as the test wants"}
                            for s, t in upload["tiles"].items() if t["refused"]],
                "part_max": self.part_max, "expires_at": "2099-01-01T00:00:00Z"}

    def upload(self, upload_id):
        if upload_id not in self.uploads:
            raise Problem(404, "not-found", "no such upload")
        return self.uploads[upload_id]

    def offset(self, upload_id, sha):
        self.upload(upload_id)
        pack = self.packs.get((upload_id, sha))
        if pack is None:
            raise Problem(404, "pack-unknown", "no byte of this pack")
        return pack["length"] if pack["done"] else len(pack["data"]), pack["length"]

    def part(self, upload_id, sha, offset, length, digest, body, whole=True):
        upload = self.upload(upload_id)
        pack = self.packs.setdefault((upload_id, sha), {"data": bytearray(), "length": length, "done": False})
        reached = pack["length"] if pack["done"] else len(pack["data"])
        if offset != reached:
            raise Problem(409, "offset-mismatch", f"the pack goes on at byte {reached}", {"Upload-Offset": str(reached)})
        if not whole:
            if self.keep_partial:
                pack["data"] += body
            return len(pack["data"])
        if length != pack["length"] or offset + len(body) > length or length > MAX_PACK:
            raise Problem(422, "pack-invalid", "lengths that do not fit")
        if digest != hashlib.sha256(body).digest():
            raise Problem(460, "digest-mismatch", "the part's SHA-256 is another one")
        pack["data"] += body
        if len(pack["data"]) < length:
            return len(pack["data"])
        data = bytes(pack["data"])
        try:
            if hashlib.sha256(data).hexdigest() != sha:
                raise ValueError("digest")
            tiles = read_pack(data)
            for digest_of, tile in tiles.items():
                if len(tile) != upload["tiles"][digest_of]["sidecar"]["size"]:
                    raise ValueError("size")
        except (ValueError, KeyError, struct.error) as error:
            del self.packs[(upload_id, sha)]
            raise Problem(422, "pack-invalid", f"not a pack of this upload: {error}")
        self.blobs.update(tiles)
        pack.update(done=True, data=bytearray())
        self.packs_taken += 1
        return length

    def complete(self, upload_id):
        upload = self.upload(upload_id)
        missing = [s for s, t in upload["tiles"].items() if not t["refused"] and s not in self.blobs]
        if missing:
            raise Problem(409, "incomplete", f"{len(missing)} tiles are missing", missing=missing)
        if upload["state"] == "open":
            upload["state"] = "judging"
        return {"upload_id": upload_id, "pending": sum(t["verdict"] == "pending" for t in upload["tiles"].values())}

    def status(self, upload_id):
        upload = self.upload(upload_id)
        if upload["state"] == "judging":
            upload["polls"] += 1
            pending = [t for t in upload["tiles"].values() if t["verdict"] == "pending"]
            half = upload["polls"] == 1 and not self.at_once
            for tile in pending[:len(pending) // 2] if half else pending:
                self.decide(tile)
            if not half:
                upload["state"] = "judged"
        return {"upload_id": upload_id, "batch": upload["key"], "state": upload["state"], "expires_at": "2099-01-01T00:00:00Z",
                "tiles": [{"sha256": s, "verdict": t["verdict"], "code": t["code"], "detail": "", "retryable": False}
                          for s, t in upload["tiles"].items()]}

    def decide(self, tile):
        code = self.judge(tile["sidecar"])
        if code:
            tile.update(verdict="rejected", code=code)
            self.rejected[tile["name"]] += 1
        elif self.accepted[tile["name"]]:
            tile["verdict"] = "duplicate"
        else:
            tile["verdict"] = "accepted"
            self.accepted[tile["name"]] += 1

    def forget(self, upload_id):
        upload = self.uploads.pop(upload_id, None)
        if upload:
            del self.by_key[upload["key"]]


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
                return self.say(Problem(429, "too-many-requests", "later", {"Retry-After": str(faults.retry_after)}))
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

    def say(self, problem):
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
