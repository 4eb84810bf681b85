"""Who has one stolen airframe key, or a token, or runs the proxy between ground station and candidate service."""
import base64
import hashlib
import http.client
import http.server
import json
import re
import shutil
import socket
import ssl
import struct
import subprocess
import threading
import time
import uuid

from .aircraft import plain_request
from .registry import attack
from .shared import canonical, day, key_id, sign
from .watching import Listener

from ground_station import Station  # noqa: E402  (shared.py has put its folder on the path)

TILE_TYPE = "application/vnd.nadir.candidate-tile.v1+json"
BATCH_TYPE = "application/vnd.nadir.candidate-batch.v1+json"
REPORT_TYPE = "application/vnd.nadir.installed.v1+json"
TILES = 40


class Candidates:
    """A context: nadir-candidates serve on a folder of the row, and a ground station with its token."""

    def __init__(self, scene, *options, made=None, data=None, trust=None, tokens=True):
        self.scene, self.made = scene, made or scene.shared.flights
        self.data = data or scene.folder / "data"
        self.port_file = scene.folder / f"port-{uuid.uuid4()}"
        self.command = ["serve", "--data", self.data, "--trust", trust or self.made / "root.json",
                        *(["--token-file", self.made / "ground-1.token"] if tokens else []), "--listen", "127.0.0.1:0", "--port-file",
                        self.port_file, "--keep-free-mb", "0", "--quiet", *options]
        self.service = self.port = None

    def __enter__(self):
        self.service = self.scene.start("nadir-candidates", *self.command)
        self.scene.wait_for(lambda: self.port_file.exists() and self.port_file.read_text().strip() or not self.service.running(), 20,
                            "it does not listen")
        self.scene.holds(self.service.running(), f"it did not start: {self.service.text()[-200:]}")
        self.port = int(self.port_file.read_text())
        self.station = Station(self, self.made)
        return self

    def __exit__(self, kind, *_):
        self.station.close()
        if kind is None:
            self.scene.end(self.service)
        else:
            self.service.running() and self.service.process.kill()

    def counts(self):
        ran = subprocess.run([self.scene.program("nadir-candidates"), "status", "--data", self.data, "--json"], capture_output=True,
                             text=True, check=True)
        return json.loads(ran.stdout)

    def settled(self):
        """The counts once nothing waits for a verdict or a vote."""
        def done():
            found = self.counts()
            return found if found["tiles"]["to_vote"] == 0 and found["uploads"]["judging"] == 0 else None
        return self.scene.wait_for(done, 25, "the votes do not end")

    def ask(self, method, path, body=None, token=None, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=15)
        try:
            sent = {} if token is None else {"Authorization": f"Bearer {token}"}
            connection.request(method, path, body, {**sent, **headers})
            answer = connection.getresponse()
            return answer.status, answer.read().decode(errors="replace")
        finally:
            connection.close()

    def announce(self, batch, token=None, key=None):
        """Status and body of the announcement of a batch (bytes)."""
        return self.ask("POST", "/v1/uploads", batch, token or self.station.token,
                        **{"Content-Type": "application/json", "Idempotency-Key": key or json.loads(batch)["signed"]["batch"]})

    def audit(self):
        return [json.loads(line) for line in (self.data / "audit" / "audit.jsonl").read_text().splitlines()]

    def upload(self, flight):
        """A Flight, the whole way, until it is judged. The status."""
        status, body = self.announce(flight.batch)
        self.scene.attacked(status in (200, 201), f"the announcement got {status} {body[:150]}")
        upload = json.loads(body)["upload_id"]
        path = self.scene.folder / "sent.pack"
        path.write_bytes(flight.pack)
        self.station.send(upload, path)
        self.station.complete(upload)
        return self.station.judged(upload)


class Flight:
    """A flight's batch and pack, made anew by somebody with the airframe's key."""

    def __init__(self, made, number=1, tiles=TILES):
        folder = made / f"flight-{number}"
        self.key = folder / "tile.key.pem"
        self.signed = json.loads((folder / "batch-0.json").read_text())["signed"]
        self.entries = self.signed["tiles"][:tiles]
        self.signed["tiles"] = self.entries
        self.images = self._images((folder / "0-0.pack").read_bytes())
        self.batch = self.pack = None

    @staticmethod
    def _images(pack):
        (count,) = struct.unpack_from(">I", pack, 8)
        at, images = 12 + 36 * count, {}
        for i in range(count):
            digest, size = struct.unpack_from(">32sI", pack, 12 + 36 * i)
            images[digest.hex()] = pack[at:at + size]
            at += size
        return images

    def change(self, flight=None, image=lambda data, number: data, batch_key=None, **sidecar):
        """Another flight's name, other images, other members; signed again."""
        old, self.images, name = self.images, {}, flight or self.signed["flight"]
        for number, entry in enumerate(self.entries):
            side = entry["sidecar"]
            data = image(old[side["sha256"]], number)
            side.update(flight=name, sha256=hashlib.sha256(data).hexdigest(), size=len(data), **sidecar)
            self.images[side["sha256"]] = data
            entry["keyid"], entry["sig"] = key_id(self.key), sign(self.key, TILE_TYPE, canonical(side))
        self.signed.update(flight=name, batch=str(uuid.uuid4()), created_at=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()))
        return self.seal(batch_key)

    def seal(self, key=None):
        key = key or self.key
        body = canonical(self.signed)
        self.batch = json.dumps({"signed": self.signed, "signatures": [{"keyid": key_id(key), "sig": sign(key, BATCH_TYPE, body)}]}).encode()
        order = [entry["sidecar"]["sha256"] for entry in self.entries]
        self.pack = b"NADIRPK1" + struct.pack(">I", len(order)) + b"".join(
            bytes.fromhex(name) + struct.pack(">I", len(self.images[name])) for name in order) + b"".join(self.images[name] for name in order)
        return self


def comment(text):
    """The JPEG with a comment: the same picture, other bytes."""
    body = text.encode()
    return lambda data, number: data[:2] + b"\xff\xfe" + struct.pack(">H", len(body) + 2) + body + data[2:]


def hours_ago(hours):
    return time.strftime("%Y-%m-%dT%H:%M:%S.000Z", time.gmtime(time.time() - 3600 * hours))


@attack("M4")
def stolen_key_promotes_alone(scene):
    """One stolen airframe key signs the same ground as flights of three days, so that they agree with one another."""
    with Candidates(scene) as service:
        for number in range(3):
            flight = Flight(service.made, tiles=8).change(f"stolen-{number}", comment(f"day {number}"), captured_at=hours_ago(30 * (number + 1)))
            judged = service.upload(flight)
        counts = service.settled()["tiles"]
        scene.attacked(counts["accepted"] == 24, f"its tiles are not accepted: {counts} {str(judged)[:150]}")
        scene.holds(counts["promoted"] == 0, f"{counts['promoted']} tiles are promoted by one key")
        other = service.upload(Flight(service.made, number=2, tiles=8).seal())
        promoted = service.settled()["tiles"]["promoted"]
        scene.attacked(promoted == 8, f"a genuine second airframe promotes {promoted}: {str(other)[:100]}")
        return "24 accepted, 0 promoted; 8 once another airframe agrees"


@attack("M3", seconds=60)
def stolen_key_crowds_out_others(scene):
    """One stolen key signs fourteen of the newest flights over false ground; two genuine airframes agree on the true one."""
    with Candidates(scene) as service:
        for number in range(14):
            flight = Flight(service.made, tiles=6)
            images = [flight.images[entry["sidecar"]["sha256"]] for entry in flight.entries]
            wrong = lambda data, place, images=images, number=number: comment(f"{number}")(images[(place + 3) % len(images)], place)
            service.upload(flight.change(f"stolen-{number}", wrong, captured_at=hours_ago(0.2 + number / 100)))
        for number in (2, 3):
            service.upload(Flight(service.made, number=number, tiles=6).seal())
        counts = service.settled()["tiles"]
        scene.attacked(counts["accepted"] == 14 * 6 + 12, f"not all are accepted: {counts}")
        scene.holds(counts["promoted"] == 6, f"only {counts['promoted']} of 6 genuine places are promoted")
        return f"{14 * 6} forged votes, 6 of 6 genuine places promoted"


@attack("M2")
def older_root_over_a_restart(scene):
    """The root that revokes a stolen key is replaced by the one before it, and the service is restarted."""
    made = scene.folder / "made"
    shutil.copytree(scene.shared.flights, made)
    root, first = made / "root.json", (made / "root.json").read_bytes()
    lost = key_id(made / "flight-1" / "tile.key.pem")
    with Candidates(scene, made=made) as service:
        service.upload(Flight(made, tiles=6).seal())
    ran = scene.run("nadir", "keys", "revoke", "--previous", root, "--revoke", lost, "--root-key", made / "root.key.pem", "--out",
                    scene.folder / "2.json")
    scene.attacked(ran.code == 0, ran.said)
    (scene.folder / "2.json").replace(root)
    with Candidates(scene, made=made) as service:
        scene.attacked(service.settled()["tiles"]["accepted"] == 0, "the revocation has no effect")
    root.write_bytes(first)
    with Candidates(scene, made=made) as service:
        status, body = service.announce(Flight(made, tiles=6).change("again", comment("again")).batch)
        refused = "airframe_revoked" in body or status >= 400
        health = service.ask("GET", "/v1/health")[1]
        scene.holds(refused, f"the revoked key uploads again: {status} {body[:100]}")
        scene.holds(service.settled()["tiles"]["accepted"] == 0, "its tiles count again")
        scene.holds('"warn"' in health, f"health does not say so: {health[:150]}")
        return f"{status} airframe_revoked; health: warn"


@attack("M5")
def base_package_that_nobody_signed(scene):
    """The map to compare with is replaced by one that an unknown key signed; then by a signed one with another tile."""
    made = scene.folder / "made"
    shutil.copytree(scene.shared.flights, made)
    foreign = scene.shared.built()
    ran = scene.run("nadir-candidates", "serve", "--data", scene.folder / "d", "--trust", made / "root.json", "--token-file", made / "ground-1.token",
                    "--listen", "127.0.0.1:0", "--package", foreign, "--quiet", limit_s=10)
    scene.rejected(ran, code=2)
    scene.attacked(ran.said.strip(), "it prints nothing")
    own = scene.shared.package(scene.folder, "own", key=made / "root.key.pem")  # make_flights' root is the signer, too
    (own / "imagery" / "base.mbtiles").write_bytes((own / "imagery" / "base.mbtiles").read_bytes()[:-4096] + bytes(4096))
    with open(own / "mission" / "mission.yaml", "a") as file:
        file.write("# edited\n")
    again = scene.run("nadir-candidates", "serve", "--data", scene.folder / "d2", "--trust", made / "root.json", "--token-file",
                      made / "ground-1.token", "--listen", "127.0.0.1:0", "--package", own, "--quiet", limit_s=10)
    scene.rejected(again, code=2)
    return ran.line("key.") or ran.said.strip()[:100]


@attack()
def batch_signed_for_another_airframe(scene):
    """The holder of mini-01's key announces tiles of mini-02."""
    with Candidates(scene) as service:
        flight = Flight(service.made, number=2, tiles=6)
        flight.key = service.made / "flight-1" / "tile.key.pem"
        status, body = service.announce(flight.change("forged").batch)
        scene.attacked(status in (200, 201, 403, 422), f"{status} {body[:100]}")
        scene.holds("batch_signature" in body or status >= 400, f"{status} {body[:150]}")
        scene.holds(service.settled()["tiles"]["accepted"] == 0, "accepted")
        return f"{status} batch_signature" if "batch_signature" in body else f"{status} {body[:80]}"


@attack()
def recorded_batch_again(scene):
    """Somebody on the network replays a recorded announcement and pack, with the token and with a changed body."""
    with Candidates(scene) as service:
        flight = Flight(service.made, tiles=6).seal()
        service.upload(flight)
        before = service.settled()["tiles"]
        status, body = service.announce(flight.batch)
        other = Flight(service.made, tiles=5).seal()
        conflict, _ = service.announce(other.batch, key=json.loads(flight.batch)["signed"]["batch"])
        scene.holds(service.settled()["tiles"] == before, "it counts twice")
        scene.holds(status == 200, f"a repetition gets {status}")
        scene.holds(conflict >= 400, f"another body under the same key gets {conflict}")
        return f"{status}, the same upload; {conflict} for another body"


@attack()
def copied_pictures_of_another_flight(scene):
    """The pictures of mini-01's flight are signed by mini-02's stolen key, byte by byte, as a second vote."""
    with Candidates(scene) as service:
        service.upload(Flight(service.made, tiles=6).seal())
        copy, first = Flight(service.made, number=2, tiles=6), Flight(service.made, tiles=6)
        pictures = [first.images[entry["sidecar"]["sha256"]] for entry in first.entries]
        judged = service.upload(copy.change("copied", lambda _, number: pictures[number]))
        counts = service.settled()["tiles"]
        scene.attacked(str(judged).count("duplicate") or counts.get("duplicate"), f"{judged}"[:150])
        scene.holds(counts["promoted"] == 0, f"{counts['promoted']} promoted")
        return "duplicate, 0 promoted"


@attack()
def tiles_of_tomorrow(scene):
    """A stolen key dates its tiles next week, so that they stay the newest."""
    with Candidates(scene) as service:
        flight = Flight(service.made, tiles=6).change("future", comment("future"), captured_at=hours_ago(-168))
        status, body = service.announce(flight.batch)
        scene.holds("captured_in_future" in body, f"{status} {body[:150]}")
        return f"{status} captured_in_future"


@attack("", memory_mb=300)
def tile_that_is_a_bomb(scene):
    """A signed tile whose JPEG claims 65 500 by 65 500 pixels, and one that is a PNG."""
    from .camera import png, with_size
    with Candidates(scene) as service:
        bomb = lambda data, number: with_size(data, 65_500, 65_500)[:-2] + bytes([number]) + b"\xff\xd9" if number % 2 else png(30_000, 30_000, 200 + number)
        judged = service.upload(Flight(service.made, tiles=6).change("bomb", bomb))
        counts = service.settled()["tiles"]
        scene.holds(counts["accepted"] == 0, f"{counts}")
        codes = dict.fromkeys(re.findall(r"'code': '([a-z_]+)'", str(judged)))
        scene.attacked(codes, f"no verdict: {str(judged)[:150]}")
        return ", ".join(codes)


@attack()
def pack_that_lies_about_its_size(scene):
    """A pack of a terabyte, an offset beyond its end, below zero, and a tile of 4 GB in its list."""
    with Candidates(scene) as service:
        flight = Flight(service.made, tiles=6).seal()
        status, body = service.announce(flight.batch)
        upload, answers = json.loads(body)["upload_id"], []
        for offset, length, data in ((0, 1 << 40, b"x"), (1 << 40, len(flight.pack), b"x"), (-1, len(flight.pack), b"x"), (0, 5, b"123456789"),
                                     (0, 1 << 64, b"x"), (0, 200, b"NADIRPK1" + struct.pack(">I", 1 << 31) + bytes(188)),
                                     (0, 100, b"NADIRPK1" + struct.pack(">I", 1) + bytes(32) + b"\xff\xff\xff\xff" + bytes(52))):
            digest = base64.b64encode(hashlib.sha256(data).digest()).decode()
            answers.append(service.ask("PATCH", f"/v1/uploads/{upload}/packs/{hashlib.sha256(data).hexdigest()}", data, service.station.token,
                                       **{"Content-Type": "application/octet-stream", "Upload-Offset": str(offset),
                                          "Upload-Length": str(length), "Content-Digest": f"sha-256=:{digest}:"})[0])
        scene.holds(all(status >= 400 for status in answers), f"taken: {answers}")
        scene.holds(service.ask("GET", "/v1/health")[0] == 200, "it does not answer any more")
        used = sum(path.stat().st_size for path in service.data.rglob("*") if path.is_file())
        scene.holds(used < 30_000_000, f"{used} bytes on the disk")
        return ", ".join(map(str, answers))


@attack()
def without_a_token(scene):
    """Every call without a token, with a wrong one, and with one in the address."""
    with Candidates(scene) as service:
        token, answers = service.station.token, []
        batch = Flight(service.made, tiles=6).seal().batch
        for wrong in (None, "", "x" * 32, token[:-1], token + "0", token.upper()):
            answers.append(service.ask("POST", "/v1/uploads", batch, wrong, **{"Content-Type": "application/json", "Idempotency-Key": str(uuid.uuid4())})[0])
            answers.append(service.ask("GET", f"/v1/reason-codes?token={token}", token=wrong)[0])
        scene.attacked(service.ask("GET", "/v1/reason-codes", token=token)[0] == 200, "the right one is not taken")
        expected = {401} if token.upper() != token else None
        scene.holds(set(answers) == {401} or expected is None, f"answers {answers}")
        return f"{len(answers)} times 401"


def tokens_file(scene, **changes):
    """A tokens file with one token, and the token."""
    secret = "f00d" * 8
    entry = {"id": "one", "client": "one", "scope": ["upload", "read"], "airframes": ["mini-01"], "expires": day(30),
             "sha256": hashlib.sha256(secret.encode()).hexdigest(), **changes}
    path = scene.folder / f"tokens-{uuid.uuid4()}.json"
    path.write_text(json.dumps({"schema": "nadir.tokens/1", "tokens": [entry]}))
    path.chmod(0o600)
    return path, secret


@attack()
def expired_token_and_another_scope(scene):
    """A token of last month; one that may only read; one for another airframe."""
    answers = []
    for changes, number in (({"expires": day(-1)}, 1), ({"scope": ["read"]}, 1), ({}, 2), ({}, 1)):
        path, secret = tokens_file(scene, **changes)
        with Candidates(scene, "--tokens", path, data=scene.folder / f"data-{len(answers)}") as service:
            answers.append(service.announce(Flight(service.made, number=number, tiles=6).seal().batch, secret)[0])
    scene.attacked(answers[3] in (200, 201), f"a right token gets {answers[3]}")
    scene.holds(answers[:3] == [401, 403, 403], f"answers {answers}")
    return f"{answers[:3]}; the right one {answers[3]}"


@attack()
def forged_lines_in_the_audit_log(scene):
    """A client tries to write lines of its own into the audit log, by paths, tokens, names and ids."""
    with Candidates(scene) as service:
        before = sum(line["act"] == "root.trust" for line in service.audit())
        forged = '"}\n{"n":1,"at":"2026-01-01T00:00:00Z","act":"root.trust","result":"as given"}\n'
        quoted = forged.replace("\n", "%0a").replace(" ", "%20")
        service.ask("GET", f"/v1/uploads/{quoted}", token=service.station.token)
        service.ask("GET", f"/v1/uploads/{quoted}", token="wrong")
        batch = Flight(service.made, tiles=6).seal().batch
        service.announce(batch, key="x")
        service.announce(batch.replace(b'"flight-1"', json.dumps("a" + forged).encode()), key=str(uuid.uuid4()))
        for line in (b"Authorization: Bearer x\x0b" + forged.encode().replace(b"\n", b"\x0b"), b"X: \x00\r\nY: y"):
            plain_request(service.port, b"GET /v1/reason-codes HTTP/1.1\r\nHost: localhost\r\n" + line + b"\r\n\r\n", 1, until=b"\r\n")
        lines = service.audit()
        scene.attacked(any(line["act"] == "call" for line in lines), f"nothing was logged: {lines}")
        scene.holds([line["n"] for line in lines] == list(range(1, len(lines) + 1)), "lines are missing or forged")
        scene.holds(sum(line["act"] == "root.trust" for line in lines) == before, "a line was forged")
        scene.holds((service.data / "audit" / "audit.jsonl").stat().st_mode & 0o077 == 0, "others may read it")
        return f"{len(lines)} lines, numbered without holes, none forged"


@attack()
def report_of_another_aircraft(scene):
    """installed.json: an old one again, one with a forged airframe, one by another's key."""
    report = json.loads((scene.shared.flights / "flight-1" / "candidates" / "installed.json").read_text())
    key = scene.shared.flights / "flight-1" / "tile.key.pem"

    def post(service, key=key, **changes):
        signed = {**report["signed"], **changes}
        body = json.dumps({"signed": signed, "signatures": [{"keyid": key_id(key), "sig": sign(key, REPORT_TYPE, canonical(signed))}]})
        return service.ask("POST", "/v1/installed", body, service.station.token, **{"Content-Type": "application/json"})[0]
    with Candidates(scene) as service:
        newer, older = post(service, number=9), post(service, number=8)
        other, wrong = post(service, number=10, airframe="mini-02"), post(service, scene.shared.flights / "flight-2" / "tile.key.pem", number=11)
        scene.attacked(newer < 300, f"a genuine report gets {newer}")
        scene.holds(older == 409 and other >= 400 and wrong >= 400, f"answers {older}, {other}, {wrong}")
        return f"{older} older, {other} for another airframe, {wrong} by another key"


@attack("", seconds=40)
def silent_clients(scene):
    """400 connections without a token that say nothing, or a byte every half second."""
    with Candidates(scene) as service:
        ends = []
        try:
            for _ in range(400):
                end = socket.socket()
                end.settimeout(2)
                end.connect(("127.0.0.1", service.port))
                ends.append(end)
            for character in b"POST":
                for end in ends[::2]:
                    try:
                        end.sendall(bytes([character]))
                    except OSError:
                        pass
                scene.holds(service.ask("GET", "/v1/health")[0] == 200, "no answer beside them")
                time.sleep(0.5)
            judged = service.upload(Flight(service.made, tiles=6).seal())
            return f"an upload goes on beside them: {judged['state']}"
        finally:
            for end in ends:
                end.close()


@attack("L9")
def host_of_the_candidate_service(scene):
    """DNS rebinding against the candidate service."""
    with Candidates(scene) as service:
        answers = [service.ask("GET", "/v1/health", Host=host)[0] for host in ("evil.com", "[::1]evil.com", "localhost.evil.com", "127.0.0.1x")]
        scene.attacked(service.ask("GET", "/v1/health", Host="[::1]:99")[0] == 200, "our own name is refused")
        scene.holds(200 not in answers, f"served: {answers}")
        return ", ".join(map(str, answers))


@attack()
def paths_and_methods(scene):
    """Packs named ../../etc/passwd, statements in names, methods that nobody implements."""
    with Candidates(scene) as service:
        answers = []
        for method, path in (("PATCH", "/v1/uploads/../../etc/passwd/packs/x"), ("GET", "/v1/uploads/%2e%2e%2f%2e%2e%2fetc%2fpasswd"),
                             ("GET", "/v1/uploads/x'; DROP TABLE uploads; --".replace(" ", "%20")), ("DELETE", "/v1/uploads/x"),
                             ("PUT", "/v1/installed"), ("TRACE", "/"), ("GET", "/v1/installed/../../x")):
            status, body = service.ask(method, path, token=service.station.token)
            scene.holds("root:x:0" not in body, "a file of the system is given")
            answers.append(status)
        scene.holds(all(status >= 400 for status in answers), f"{answers}")
        return ", ".join(map(str, answers))


@attack()
def quota_of_a_stolen_key(scene):
    """A stolen key announces more than its airframe may send a day."""
    with Candidates(scene, "--quota-mb", "1") as service:
        answers = []
        for number in range(4):
            answers.append(service.announce(Flight(service.made).change(f"flood-{number}", comment(str(number))).batch))
        refused = [body for status, body in answers if status >= 400 or "quota" in body]
        scene.attacked(answers[0][0] in (200, 201), f"the first gets {answers[0][0]}")
        scene.holds(refused, "all are taken")
        return f"{[status for status, _ in answers]}"


# ---- the proxy

def staged(scene):
    """An outbox with one flight to push."""
    def make(folder):
        flight = scene.shared.flights / "flight-1"
        scene.shared.must("sync", "stage", flight / "candidates", "--outbox", folder / "outbox", "--key", flight / "tile.key.pem")
    made = scene.shared.once("outbox", make)
    shutil.copytree(made / "outbox", scene.folder / "outbox")
    return scene.folder / "outbox"


def push(scene, url, *more, limit_s=60, **environment):
    return scene.run("nadir", "sync", "push", staged(scene), "--to", url, "--token-file", scene.shared.flights / "ground-1.token", *more,
                     environment=environment, limit_s=limit_s)


class Proxy:
    """A context: a service that answers every request by respond(request, path) → (status, headers, chunks)."""

    def __init__(self, respond, context=None):
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def handle_any(self):
                length = int(self.headers.get("Content-Length") or 0)
                self.rfile.read(length)
                outer.calls += 1
                outer.tokens += "Authorization" in self.headers
                status, headers, chunks = respond(self, self.path)
                self.send_response(status)
                for name, value in headers.items():
                    self.send_header(name, value)
                self.end_headers()
                try:
                    for chunk in chunks:
                        self.wfile.write(chunk)
                        self.wfile.flush()
                except OSError:
                    pass
                self.close_connection = True
            do_GET = do_POST = do_HEAD = do_PATCH = handle_any

            def log_message(self, *_):
                pass
        self.calls = self.tokens = 0
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.server.handle_error = lambda *_: None
        if context is not None:
            self.server.socket = context.wrap_socket(self.server.socket, server_side=True)
        self.port = self.server.server_address[1]

    def __enter__(self):
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_):
        self.server.shutdown()
        self.server.server_close()


def trickle(seconds=300):
    for _ in range(2 * seconds):
        yield b"x"
        time.sleep(0.5)


def endless():
    while True:
        yield b" " * 1_000_000


@attack("L10", seconds=50)
def proxy_that_trickles(scene):
    """The proxy answers at two bytes a second, for ever."""
    with Proxy(lambda *_: (200, {"Content-Type": "application/json", "Content-Length": "100000"}, trickle())) as proxy:
        ran = push(scene, f"http://localhost:{proxy.port}", "--timeout-s", "5", limit_s=45)
        scene.attacked(proxy.calls, "it was not called")
        scene.rejected(ran, code=2)
        return f"gave up after {ran.seconds:.0f} s with --timeout-s 5"


@attack(memory_mb=150, seconds=50)
def proxy_without_end(scene):
    """The proxy's answer never ends."""
    with Proxy(lambda *_: (201, {"Content-Type": "application/json"}, endless())) as proxy:
        ran = push(scene, f"http://localhost:{proxy.port}", "--timeout-s", "5", limit_s=45)
        scene.attacked(proxy.calls, "it was not called")
        return scene.rejected(ran, code=2) and ran.said.strip().splitlines()[-1][:100]


@attack(seconds=50)
def proxy_that_sends_elsewhere(scene):
    """The proxy redirects to a server of its own, to be given the token and the tiles there."""
    with Listener(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n") as thief:
        with Proxy(lambda *_: (307, {"Location": f"http://127.0.0.1:{thief.port}/v1/uploads", "Content-Length": "0"}, ())) as proxy:
            ran = push(scene, f"http://localhost:{proxy.port}", "--timeout-s", "3", limit_s=45)
            scene.attacked(proxy.calls, "it was not called")
            scene.holds(thief.calls == 0, f"the redirect is followed: {thief.received[:80]}")
            scene.rejected(ran, code=2)
            return "not followed"


@attack(seconds=50)
def proxy_that_lies(scene):
    """The proxy answers 200 with HTML, with verdicts for tiles that nobody sent, and offsets beyond the end."""
    answers = []
    verdict = json.dumps({"upload_id": "x", "state": "judged", "tiles": [{"sha256": "0" * 64, "verdict": "accepted"}]}).encode()
    for body in (b"<html>captive portal</html>", verdict, b'{"upload_id": "../../../etc", "missing": []}', b"{}", b"[" * 50_000):
        respond = lambda *_, body=body: (201, {"Content-Type": "application/json", "Content-Length": str(len(body)),
                                               "Upload-Offset": str(1 << 62), "Retry-After": "99999999999999999999"}, (body,))
        with Proxy(respond) as proxy:
            shutil.rmtree(scene.folder / "outbox", ignore_errors=True)
            ran = push(scene, f"http://localhost:{proxy.port}", "--timeout-s", "1", limit_s=30)
            scene.attacked(proxy.calls, "it was not called")
            answers.append(ran.code)
            status = scene.run("nadir", "sync", "status", scene.folder / "outbox", "--json")
            scene.holds(json.loads(status.out).get("accepted", 0) == 0, "tiles count as accepted")
    scene.holds(0 not in answers, f"exit codes {answers}")
    scene.code = answers[-1]
    return f"exit codes {answers}, nothing counts as accepted"


@attack()
def token_in_clear_text(scene):
    """The service's address is http:// on another machine: the token would cross the network in clear text."""
    ran = push(scene, "http://192.0.2.1:8760", "--timeout-s", "2", limit_s=15)
    return scene.rejected(ran, "https", code=2)


@attack(seconds=50)
def proxy_from_the_environment(scene):
    """http_proxy and ALL_PROXY lead the connection, with its token, to somebody else."""
    with Listener(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n") as thief:
        where = f"http://127.0.0.1:{thief.port}"
        with Proxy(lambda *_: (503, {"Content-Length": "0"}, ())) as proxy:
            push(scene, f"http://localhost:{proxy.port}", "--timeout-s", "2", limit_s=45, http_proxy=where, HTTP_PROXY=where, ALL_PROXY=where,
                 all_proxy=where)
            scene.attacked(proxy.calls, "the service was not called")
            scene.holds(b"Bearer" not in thief.received and thief.calls == 0, "the proxy was asked")
            return "not used"


@attack(seconds=50)
def proxy_with_its_own_certificate(scene):
    """A proxy with a certificate of its own opens the TLS connection."""
    pem = scene.folder / "own.pem"
    subprocess.run(["openssl", "req", "-x509", "-newkey", "ed25519", "-nodes", "-keyout", pem, "-out", scene.folder / "cert.pem", "-days", "2",
                    "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"], check=True, capture_output=True)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(scene.folder / "cert.pem", pem)
    with Proxy(lambda *_: (503, {"Content-Length": "0"}, ()), context) as proxy:
        ran = push(scene, f"https://localhost:{proxy.port}", "--timeout-s", "2", limit_s=45)
        scene.holds(proxy.tokens == 0, "the token was sent to it")
        scene.rejected(ran, code=2)
        scene.attacked("certificate" in ran.said.lower() or "TLS" in ran.said or "SSL" in ran.said, ran.said[-150:])
        # With its certificate as an authority the same server is called: so it was the certificate.
        shutil.rmtree(scene.folder / "outbox")
        push(scene, f"https://localhost:{proxy.port}", "--timeout-s", "2", "--ca", scene.folder / "cert.pem", limit_s=45)
        scene.attacked(proxy.tokens > 0, "the server does not work at all")
        return ran.line("certificate")[:100]


@attack()
def tile_changed_in_the_outbox(scene):
    """A tile in the outbox on the ground station's disk is replaced before it is sent."""
    outbox = staged(scene)
    changed = 0
    for path in outbox.rglob("*"):
        if path.is_file():
            data = path.read_bytes()
            at = data.find(b"\xff\xd8\xff")
            if at >= 0 and len(data) > at + 3000:
                path.write_bytes(data[:at + 2000] + b"\x55" * 64 + data[at + 2064:])
                changed += 1
    scene.attacked(changed, "no image was found in the outbox")
    with Candidates(scene) as service:
        ran = scene.run("nadir", "sync", "push", outbox, "--to", f"http://localhost:{service.port}", "--token-file",
                        service.made / "ground-1.token", "--timeout-s", "5")
        scene.holds(ran.code in (1, 2), f"exit code {ran.code}: {ran.said[-150:]}")
        scene.holds(service.settled()["tiles"]["accepted"] < TILES, "the changed tile is accepted")
        return ran.line("damaged") or ran.said.strip().splitlines()[-1][:100]
