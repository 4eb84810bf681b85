"""What the tests of the running desk share: a simulated map and flight, and the program that serves them."""
import http.client
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time
import uuid

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "e2e"), str(HERE.parent / "api")]
import support  # noqa: E402

PATIENCE_S = 120
FRAMES = 12


def make_world(folder):
    """A signed package of a simulated landscape, and a flight over it on another day."""
    def good(*args):
        result = support.run(*args)
        assert result.returncode == 0, f"{args}\n{result.stdout}\n{result.stderr}"
    good("simulate", "world", "--seed", 7, "--size-km", 0.7, "--gsd-m", 0.5, "--out", folder / "world")
    for name in ("root", "signer"):
        good("keys", "create", "--out", folder / name)
    good("keys", "root", "--root-key", folder / "root.key.pem", "--package-signer", folder / "signer.pub.pem", "--expires", "2035-01-01",
         "--out", folder / "root.json")
    world = folder / "world"
    good("cache", "build", "--mission", world / "mission.yaml", "--imagery", world / "map.tif", "--dem", world / "dem.tif", "--key",
         folder / "signer.key.pem", "--out", folder / "package")
    good("simulate", "flight", "--world", world / "ground.tif", "--dem", world / "dem.tif", "--mission", world / "mission.yaml", "--camera",
         world / "camera.yaml", "--seed", 11, "--max-frames", FRAMES, "--out", folder / "flight")


class Desk:
    """`nadir desk serve` over a folder; it may be killed and started again."""

    def __init__(self, root, made, *options):
        self.root, self.made, self.options, self.process = pathlib.Path(root), made, options, None
        (self.root / "packages").mkdir(parents=True, exist_ok=True)
        if not (self.root / "packages" / "valley").exists():
            shutil.copytree(made / "package", self.root / "packages" / "valley")
        self.at = re.search(r"^created: *(\S+)", (made / "world" / "mission.yaml").read_text(), re.MULTILINE).group(1)

    def start(self, listen="127.0.0.1:0"):
        port_file = self.root / "port"
        port_file.unlink(missing_ok=True)
        self.process = subprocess.Popen([support.NADIR, "desk", "serve", "--root", self.root, "--trust", self.made / "root.json", "--at", self.at,
                                         "--listen", listen, "--port-file", port_file, "--quiet", *map(str, self.options)],
                                        stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + PATIENCE_S
        while not port_file.exists() or not port_file.read_text().endswith("\n"):
            assert self.process.poll() is None, self.process.stderr.read()
            assert time.monotonic() < deadline, "the desk does not start"
            time.sleep(0.02)
        self.port = int(port_file.read_text())
        self.url = f"http://127.0.0.1:{self.port}"
        return self

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stderr.close()

    def stop(self):
        if self.process and self.process.poll() is None:
            self.process.terminate()
        code = self.process.wait(timeout=PATIENCE_S)
        if not self.process.stderr.closed:
            self.process.stderr.close()
        return code

    def call(self, method, path, body=None, headers=None):
        """(status, headers, bytes); ConnectionError when the desk is gone."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        try:
            connection.request(method, path, body=body, headers=headers or {})
            response = connection.getresponse()
            return response.status, response.headers, response.read()
        except (http.client.HTTPException, OSError) as error:
            raise ConnectionError(str(error)) from error
        finally:
            connection.close()

    def json(self, method, path, document=None, expect=None):
        body = None if document is None else json.dumps(document)
        status, _, answer = self.call(method, path, body, {"Content-Type": "application/json"} if body else {})
        assert expect is None or status == expect, f"{method} {path}: {status} {answer[:2000]!r}"
        return json.loads(answer)

    def create(self, name="simulated", **more):
        camera = (self.made / "flight" / "camera.yaml").read_text()
        return "/v1/flights/" + self.json("POST", "/v1/flights", {"name": name, "camera": camera, **more}, 201)["id"]

    def frames(self):
        return sorted((self.made / "flight" / "frames").iterdir())

    def telemetry(self):
        return (self.made / "flight" / "telemetry.csv").read_text()

    def send(self, flight, pictures, telemetry=None):
        """The answers, by name."""
        boundary = uuid.uuid4().hex
        parts = [("telemetry\"; filename=\"telemetry.csv", "text/csv", (telemetry or self.telemetry()).encode())]
        parts += [(f"picture\"; filename=\"{path.name}", "image/jpeg", path.read_bytes()) for path in pictures]
        body = b"".join(f"--{boundary}\r\nContent-Disposition: form-data; name=\"{name}\"\r\nContent-Type: {kind}\r\n\r\n".encode() + data + b"\r\n"
                        for name, kind, data in parts) + f"--{boundary}--\r\n".encode()
        status, _, answer = self.call("POST", flight + "/pictures", body, {"Content-Type": f"multipart/form-data; boundary={boundary}"})
        assert status == 200, answer
        return {picture["name"]: picture for picture in json.loads(answer)["pictures"]}

    def settled(self, flight):
        """The flight's document once all its pictures are processed and nothing is to do."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            document = self.json("GET", flight, expect=200)
            pictures = document["pictures"]
            if pictures["accepted"] == pictures["processed"] and not document["completion_requested"] and document["state"] in ("idle", "completed"):
                return document
            assert document["state"] not in ("blocked", "damaged"), document
            time.sleep(0.05)
        raise AssertionError(f"never settled: {document}")

    def events(self, flight, after=0, until=None):
        """The events after that number, up to the one of number `until`: (id, kind, data)."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        connection.request("GET", flight + "/events", headers={"Last-Event-ID": str(after)})
        response = connection.getresponse()
        found, event = [], {}
        while not found or found[-1][0] < until:
            line = response.readline().decode().rstrip("\n")
            if not line and event.get("data"):
                found.append((int(event["id"]), event["event"], json.loads(event["data"])))
                event = {}
            name, colon, value = line.partition(": ")
            if colon and name:
                event[name] = value
        connection.close()
        return found
