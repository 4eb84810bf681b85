"""What the attacks share, made once: keys, roots, signed packages, an airframe, a link key; and how to sign as the holder
of a stolen key does."""
import base64
import datetime
import hashlib
import json
import pathlib
import shutil
import socket
import subprocess
import sys
import tempfile
import threading

TESTS = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(TESTS / "e2e"), str(TESTS / "candidates")]
import support  # noqa: E402
from loop.signing import sign_airframe  # noqa: E402

NOW = datetime.datetime.now(datetime.timezone.utc).replace(microsecond=0)
TOKEN = "0123456789abcdef0123456789abcdef"


def day(days):
    return (NOW + datetime.timedelta(days=days)).strftime("%Y-%m-%dT%H:%M:%SZ")


CAMERA = {"model": "pinhole", "width": 320, "height": 240, "fx": 250.0, "fy": 250.0, "cx": 159.5, "cy": 119.5,
          "distortion": [], "uncertainty": {"heading_deg": 5.0, "agl_relative": 0.03, "tilt_deg": 2.0}}


def free_port(kind=socket.SOCK_STREAM):
    with socket.socket(socket.AF_INET, kind) as end:
        end.bind(("127.0.0.1", 0))
        return end.getsockname()[1]


def pae(kind, body):
    return b"DSSEv1 %d %s %d %s" % (len(kind), kind.encode(), len(body), body)


def canonical(value):
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()


def sign(key, kind, body):
    """The base64 of an Ed25519 signature in DSSE's encoding, by openssl."""
    with tempfile.NamedTemporaryFile() as message:
        message.write(pae(kind, body))
        message.flush()
        made = subprocess.run(["openssl", "pkeyutl", "-sign", "-rawin", "-inkey", key, "-in", message.name],
                              stdin=subprocess.DEVNULL, capture_output=True, check=True)
    return base64.b64encode(made.stdout).decode()


def key_id(key):
    """Of a private key's file: SHA-256 of the public key in DER."""
    made = subprocess.run(["openssl", "pkey", "-in", key, "-pubout", "-outform", "DER"], capture_output=True, check=True)
    return hashlib.sha256(made.stdout).hexdigest()


class Shared:
    def __init__(self, programs, folder):
        self.programs, self.folder = programs, folder
        self.lock, self.made = threading.RLock(), {}

    def once(self, name, make):
        """What make(folder) leaves in a folder of its own, made the first time that it is asked for."""
        with self.lock:
            if name not in self.made:
                folder = self.folder / name
                folder.mkdir()
                make(folder)
                self.made[name] = folder
            return self.made[name]

    def must(self, *command, program="nadir"):
        words = [str(word) for word in (self.programs / program, *command)]
        made = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        if made.returncode != 0:
            raise SystemExit(f"{' '.join(words)}: {made.returncode}: {(made.stderr + made.stdout).strip()[-600:]}")
        return made.stdout

    # ---- keys and roots

    @property
    def keys(self):
        """root, signer, hangar (signs airframes), tile (of mini-07), untrusted; root.json names the first four."""
        def make(folder):
            for name in ("root", "signer", "hangar", "tile", "untrusted"):
                self.must("keys", "create", "--out", folder / name)
            self.must("keys", "root", "--root-key", folder / "root.key.pem", "--package-signer", folder / "signer.pub.pem",
                      "--airframe-signer", folder / "hangar.pub.pem", "--tile-signer", f"mini-07={folder / 'tile.pub.pem'}",
                      "--expires", day(3650)[:10], "--out", folder / "root.json")
            (folder / "link.key").write_text("5a" * 32 + "\n")
            (folder / "link.key").chmod(0o600)
            (folder / "api.token").write_text(TOKEN + "\n")
            (folder / "api.token").chmod(0o600)
        return self.once("keys", make)

    @property
    def root(self):
        return self.keys / "root.json"

    # ---- packages

    @property
    def map(self):
        def make(folder):
            support.write_map(folder / "map.tif")
            item = json.loads((folder / "map.json").read_text())
            item["properties"]["datetime"] = day(-60)
            (folder / "map.json").write_text(json.dumps(item))
        return self.once("map", make) / "map.tif"

    @staticmethod
    def mission_text(sequence=1, created=-2, expires=60, airframes="mini-07", series="small"):
        text = support.MISSION.format(sequence=sequence)
        for old, new in (("2024-10-30T00:00:00Z", day(created)), ("2024-11-30T00:00:00Z", day(expires)),
                         ("airframes: [mini-07]", f"airframes: [{airframes}]"), ("series: small", f"series: {series}")):
            assert old in text, old
            text = text.replace(old, new)
        return text

    def package(self, folder, name="package", container="mbtiles", key=None, **mission):
        """A copy of a signed package in `folder`, for the attack to spoil."""
        shutil.copytree(self.built(container, key, **mission), folder / name, symlinks=True)
        return folder / name

    def built(self, container="mbtiles", key=None, **mission):
        key = key or self.keys / "signer.key.pem"
        text = self.mission_text(**mission)

        def make(folder):
            (folder / "mission.yaml").write_text(text)
            self.must("cache", "build", "--mission", folder / "mission.yaml", "--imagery", self.map, "--format", container,
                      "--key", key, "--out", folder / "package")
        name = hashlib.sha256(f"{container} {key} {text}".encode()).hexdigest()[:12]
        return self.once(f"package-{name}", make) / "package"

    def sign_manifest(self, package, key=None):
        """Signs the package's manifest as it is now, as the holder of a package signer's key does."""
        key = key or self.keys / "signer.key.pem"
        beside = package / "manifest.sig"
        kind = json.loads(beside.read_text())["payloadType"]
        beside.write_text(json.dumps({"payloadType": kind, "signatures": [
            {"keyid": key_id(key), "sig": sign(key, kind, (package / "manifest.json").read_bytes())}]}))

    # ---- an aircraft

    def airframe(self, folder, key=None, **changes):
        """airframe.json, signed."""
        path = folder / "airframe.json"
        path.write_text(json.dumps({"format": "nadir.airframe/1", "airframe": "mini-07", "camera": CAMERA, **changes}, indent=1))
        sign_airframe(path, key or self.keys / "hangar.key.pem", self.root)
        return path

    # ---- flights for the candidate service

    @property
    def flights(self):
        """What make_flights writes: two flights of two airframes, a root, a token."""
        def make(folder):
            folder.rmdir()
            subprocess.run([self.programs / "make_flights", folder, "3", "40"], check=True, capture_output=True)
        return self.once("flights", make)

    def prepare(self):
        """What nearly every row needs is not part of its time."""
        self.built()
        self.keys
