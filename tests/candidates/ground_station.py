"""A ground station in a few lines, for tests: announces what make_flights wrote, sends what is missing, asks for verdicts.
It knows the contract (schemas/candidates.openapi.yaml) and nothing of the service's insides.
"""
import base64
import hashlib
import http.client
import json
import pathlib
import subprocess
import time


class Service:
    """nadir-candidates as a process of its own."""

    def __init__(self, program, made, data, *options, env=None):
        self.program, self.made, self.data, self.options, self.env = program, made, data, options, env
        self.process = None
        self.port = None

    def start(self):
        port_file = self.data.parent / "port"
        port_file.unlink(missing_ok=True)
        self.process = subprocess.Popen(
            [self.program, "serve", "--data", self.data, "--trust", self.made / "root.json", "--token-file",
             self.made / "ground-1.token", "--listen", "127.0.0.1:0", "--port-file", port_file, "--keep-free-mb", "0", "--quiet",
             *self.options],
            env=self.env, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        while not port_file.exists():
            if self.process.poll() is not None:
                raise RuntimeError(self.process.stderr.read())
            time.sleep(0.01)
        self.port = int(port_file.read_text())

    def kill(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.process.stderr.close()

    def stop(self):
        if self.process and self.process.poll() is None:
            self.process.terminate()
            self.process.wait()
            self.process.stderr.close()
        return self.process.returncode if self.process else None


class Station:
    """before_answer: called when a request has gone out and its answer has not come yet."""

    def __init__(self, service, made, before_answer=lambda: None):
        self.service, self.before_answer = service, before_answer
        self.token = (made / "ground-1.token").read_text().strip()
        self.connection = None

    def ask(self, method, path, body=None, **headers):
        """Status, headers, body; a connection that breaks is the caller's to deal with."""
        if self.connection is not None and self.connection.port != self.service.port:
            self.close()
        if self.connection is None:
            self.connection = http.client.HTTPConnection("127.0.0.1", self.service.port, timeout=120)
        try:
            self.connection.request(method, path, body, {"Authorization": f"Bearer {self.token}", **headers})
            self.before_answer()
            response = self.connection.getresponse()
            return response.status, response.headers, response.read()
        except (OSError, http.client.HTTPException):
            self.close()
            raise

    def close(self):
        if self.connection is not None:
            self.connection.close()
        self.connection = None

    def announce(self, batch_file):
        body = batch_file.read_bytes()
        key = json.loads(body)["signed"]["batch"]
        status, _, answer = self.ask("POST", "/v1/uploads", body, **{"Content-Type": "application/json", "Idempotency-Key": key})
        if status not in (200, 201):
            raise RuntimeError(f"{status} {answer}")
        return json.loads(answer)

    def send(self, upload, pack_file, part=1 << 20, acknowledged=None):
        """acknowledged: called with every offset that the service has confirmed."""
        pack = pack_file.read_bytes()
        path = f"/v1/uploads/{upload}/packs/{hashlib.sha256(pack).hexdigest()}"
        status, headers, _ = self.ask("HEAD", path)
        at = int(headers["Upload-Offset"]) if status == 200 else 0
        while at < len(pack):
            piece = pack[at:at + part]
            digest = base64.b64encode(hashlib.sha256(piece).digest()).decode()
            status, headers, body = self.ask(
                "PATCH", path, piece, **{"Content-Type": "application/octet-stream", "Upload-Offset": str(at),
                                         "Upload-Length": str(len(pack)), "Content-Digest": f"sha-256=:{digest}:"})
            if status not in (204, 409):
                raise RuntimeError(f"{status} {body}")
            if status == 204 and int(headers["Upload-Offset"]) != at + len(piece):
                raise RuntimeError(f"sent up to {at + len(piece)}, has {headers['Upload-Offset']}")
            at = int(headers["Upload-Offset"])
            if acknowledged is not None:
                acknowledged[path] = at

    def complete(self, upload):
        status, _, body = self.ask("POST", f"/v1/uploads/{upload}/complete")
        if status != 202:
            raise RuntimeError(f"{status} {body}")

    def status(self, upload):
        status, _, body = self.ask("GET", f"/v1/uploads/{upload}")
        if status != 200:
            raise RuntimeError(f"{status} {body}")
        return json.loads(body)

    def judged(self, upload):
        while True:
            status = self.status(upload)
            if status["state"] == "judged":
                return status
            time.sleep(0.05)

    def upload(self, flight, number=0, **how):
        """One batch of a flight, the whole way. Returns the upload's id."""
        upload = self.announce(flight / f"batch-{number}.json")["upload_id"]
        for pack in sorted(flight.glob(f"{number}-*.pack")):
            self.send(upload, pack, **how)
        self.complete(upload)
        return upload


def counts(program, data, *options, env=None):
    result = subprocess.run([program, "status", "--data", data, "--json", *options], env=env, capture_output=True, text=True,
                            check=True)
    return json.loads(result.stdout)


def settled(program, data, *options, env=None):
    """The counts once every vote is closed."""
    while True:
        found = counts(program, data, *options, env=env)
        if found["tiles"]["to_vote"] == 0 and found["uploads"]["judging"] == 0:
            return found
        time.sleep(0.1)


def flights_in(made):
    return sorted(pathlib.Path(made).glob("flight-*"), key=lambda folder: int(folder.name.split("-")[1]))
