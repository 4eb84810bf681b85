#!/usr/bin/env python3
"""Imagery in object storage: a real S3 server behind a gateway that can fail in all the ways that servers fail
(tests/support/object_store.py), and a web server.

A build of pinned objects has the bytes of the build of the same files on this machine, and says nothing of where they
came from."""
import contextlib
import hashlib
import http.server
import json
import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "support"))

from object_store import ACCESS_KEY, BUCKET, REGION, SECRET_KEY, Gateway, ObjectStore, error_document, serve
from support import AT, EAST, NADIR, NORTH, SOUTH, STAC, WEST, EndToEnd, main, made_once, write_map

BLOCK = 1 << 20
FACTS = ["--captured", "2024-06-01", "--gsd-m", "0.5", "--ce90-m", "4", "--provider", "test", "--licence", "CC0-1.0"]
# Short waits, so that a server that does not answer costs a test seconds.
PATIENCE = {"GDAL_HTTP_CONNECTTIMEOUT": "2", "GDAL_HTTP_LOW_SPEED_TIME": "1", "GDAL_HTTP_TIMEOUT": "10", "GDAL_HTTP_MAX_RETRY": "2"}


class WebServer(http.server.BaseHTTPRequestHandler):
    """Files of a folder, by ranges. `server.answers` maps a path to a function that answers in its place."""
    protocol_version = "HTTP/1.1"
    answer, log_message = Gateway.answer, Gateway.log_message

    def do_GET(self):
        if special := self.server.answers.get(self.path):
            special(self)
            return
        file = self.server.folder / self.path.lstrip("/")
        if not file.is_file():
            self.answer(404)
            return
        data = file.read_bytes()
        first, last = map(int, re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers["Range"]).groups())
        part = data[first:last + 1]
        self.answer(206, part, Content_Range=f"bytes {first}-{first + len(part) - 1}/{len(data)}")


def redirect_to(target):
    return lambda handler: handler.answer(302, Location=target)


def write_large(folder):
    """The map of support.py, and a COG of 16 MB with 25 times its area around it: of that a build needs the middle."""
    write_map(folder / "map.tif")
    width, height, side = EAST - WEST, NORTH - SOUTH, 4000
    noise = os.urandom(2 * side)
    pgm = folder / "large.pgm"
    pgm.write_bytes(b"P5 %d %d 255\n" % (side, side) + b"".join(noise[y:y + side] for y in range(side)))
    subprocess.run(["gdal_translate", "-q", "-of", "COG", "-co", "COMPRESS=NONE", "-co", "OVERVIEWS=NONE", "-a_srs", "EPSG:4326", "-a_ullr",
                    *map(str, (WEST - 2 * width, NORTH + 2 * height, EAST + 2 * width, SOUTH - 2 * height)), pgm, folder / "large.tif"], check=True)
    pgm.unlink()


def tree(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


class ObjectStorage(EndToEnd):
    @classmethod
    def setUpClass(cls):
        cls.store = ObjectStore()
        cls.addClassCleanup(cls.store.stop)
        cls.gateway = cls.store.gateway

    def setUp(self):
        super().setUp()
        shutil.copytree(made_once("large", write_large), self.folder, dirs_exist_ok=True)
        self.mission()
        self.web = serve(WebServer, folder=self.folder, answers={})
        self.addCleanup(self.web.stop)
        self.url = f"http://127.0.0.1:{self.web.server_port}"
        os.environ.update({**self.store.environment(), **PATIENCE})
        self.store.reset()

    def pin(self, *sources, name="sources.json", facts=FACTS):
        result = self.good("cache", "pin", *sources, *facts)
        (self.folder / name).write_text(result.stdout)
        return self.folder / name

    def pinned_large(self):
        self.store.put("alps/large.tif", (self.folder / "large.tif").read_bytes())
        return self.pin(f"s3://{BUCKET}/alps/large.tif")

    def inputs(self, imagery, *more):
        return ["--mission", self.folder / "mission.yaml", "--imagery", imagery, *more]

    def build(self, imagery, out, *more):
        self.good("cache", "build", *self.inputs(imagery, *more), "--out", self.folder / out)
        return self.folder / out

    def build_fails(self, imagery, *mentions):
        return self.fails(2, "cache", "build", *self.inputs(imagery), "--out", self.folder / "package", mentions=mentions,
                          leaves_nothing=self.folder / "package")

    # --- what works

    def test_a_build_of_an_object_is_that_of_the_file_and_says_nothing_of_its_place(self):
        sources = self.pinned_large()
        size = (self.folder / "large.tif").stat().st_size
        self.assertLessEqual(self.gateway.bytes, size + 2 * BLOCK)  # it is opened at the end
        asset = json.loads(sources.read_text())["features"][0]["assets"]["data"]
        self.assertEqual(f"s3://{BUCKET}/alps/large.tif", asset["href"])
        self.assertEqual("1220" + hashlib.sha256((self.folder / "large.tif").read_bytes()).hexdigest(), asset["file:checksum"])
        self.gateway.bytes = 0
        remote = self.build(sources, "remote")
        read = self.gateway.bytes
        self.assertLess(read, 0.6 * size, "a build reads what it needs")
        self.gateway.bytes = 0
        self.assertEqual(tree(remote), tree(self.build(sources, "threads", "--threads", 8)))
        self.assertEqual(read, self.gateway.bytes, "each block once, whoever wants it")
        local = self.build(self.folder / "large.tif", "local", *FACTS)
        self.assertEqual(tree(local), tree(remote))
        for name, data in {**tree(remote), "sources": sources.read_bytes()}.items():
            for secret in (ACCESS_KEY, SECRET_KEY, "X-Amz", "127.0.0.1"):
                self.assertNotIn(secret.encode(), data, name)
        for data in tree(remote).values():
            self.assertNotIn(b"s3://", data)

    def test_shards_of_an_object(self):
        sources = self.pinned_large()
        plan = self.folder / "plan"
        self.good("cache", "plan-shards", *self.inputs(sources), "--shards", 3, "--out", plan)
        self.assertNotIn(SECRET_KEY, (plan / "plan.json").read_text())
        for shard in (3, 1, 2):
            self.good("cache", "build", "--plan", plan, "--shard", f"{shard}/3")
        self.good("cache", "merge", "--plan", plan, "--out", self.folder / "merged")
        self.assertEqual(tree(self.build(sources, "whole")), tree(self.folder / "merged"))
        (self.folder / "plan" / "shard-1-of-3").rename(self.folder / "kept")
        self.store.put("alps/large.tif", b"other bytes" * 500_000)
        self.fails(2, "cache", "build", "--plan", plan, "--shard", "1/3", mentions=["changed since it was pinned", "s3://imagery/alps/large.tif"])
        self.assertFalse((plan / "shard-1-of-3").exists())

    def test_what_was_begun_from_objects_continues_from_files(self):
        sources = self.pinned_large()
        self.gateway.fault = lambda handler: time.sleep(0.2)
        command = [NADIR, "cache", "build", *map(str, self.inputs(sources)), "--threads", "1", "--out", str(self.folder / "package")]
        killed = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        journal = self.folder / ".package.staging" / "build.journal"
        while not (journal.exists() and journal.stat().st_size > 100_000) and killed.poll() is None:
            time.sleep(0.01)
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        self.gateway.fault = None
        result = self.good("cache", "build", *self.inputs(self.folder / "large.tif", *FACTS), "--out", self.folder / "package", "--resume", "--json")
        self.assertGreater(json.loads(result.stdout)["resumed_tiles"], 0)
        self.assertEqual(tree(self.build(self.folder / "large.tif", "local", *FACTS)), tree(self.folder / "package"))

    def test_other_stores_and_web_servers(self):
        data = (self.folder / "large.tif").read_bytes()
        expected = tree(self.build(self.folder / "large.tif", "local", *FACTS))
        asked = []

        def in_store(handler):
            asked.append(handler.path)
            first, last = map(int, re.fullmatch(r"bytes=(\d+)-(\d+)", handler.headers["Range"]).groups())
            part = data[first:last + 1]
            handler.answer(206, part, Content_Range=f"bytes {first}-{first + len(part) - 1}/{len(data)}")
            return True
        self.gateway.fault = in_store
        endpoint = f"http://127.0.0.1:{self.gateway.server_port}"
        key = "bmFkaXI="
        os.environ.update({"CPL_GS_ENDPOINT": endpoint + "/", "GS_ACCESS_KEY_ID": "GOOG1", "GS_SECRET_ACCESS_KEY": SECRET_KEY,
                           "AZURE_STORAGE_CONNECTION_STRING": f"DefaultEndpointsProtocol=http;AccountName=acc;AccountKey={key};BlobEndpoint={endpoint}/acc"})
        for source, signed in ((f"gs://{BUCKET}/large.tif", "Signature="), (f"/vsiaz/{BUCKET}/large.tif", "sig="), (f"{self.url}/large.tif", None)):
            with self.subTest(source):
                asked.clear()
                out = f"package-{source[:5].strip('/:')}"
                self.assertEqual(expected, tree(self.build(self.pin(source), out)))
                if signed:
                    self.assertTrue(asked and all(signed in path for path in asked), asked[:2])

    def test_several_files_and_other_formats(self):
        subprocess.run(["gdal_translate", "-q", "-of", "JP2OpenJPEG", "-co", "QUALITY=100", "-co", "REVERSIBLE=YES", self.folder / "map.tif",
                        self.folder / "web.jp2"], check=True)
        subprocess.run(["gdal_translate", "-q", "-of", "MBTILES", "-co", "TILE_FORMAT=PNG", self.folder / "map.tif", self.folder / "web.mbtiles"], check=True)
        for name in ("web.jp2", "web.mbtiles"):
            with self.subTest(name):
                local = self.build(self.folder / name, f"local-{name}", *FACTS)
                self.assertEqual(tree(local), tree(self.build(self.pin(f"{self.url}/{name}"), f"remote-{name}")))
        # An item beside a raster on this machine is its item in the list.
        both = self.pin(f"{self.url}/large.tif", self.folder / "map.tif", facts=FACTS)
        self.assertEqual(["large", "map"], [item["id"] for item in json.loads(both.read_text())["features"]])
        local = self.folder / "both"
        self.good("cache", "build", "--mission", self.folder / "mission.yaml", "--imagery", self.folder / "large.tif", "--imagery", self.folder / "map.tif",
                  *FACTS, "--out", local)
        self.assertEqual(tree(local), tree(self.build(both, "remote-both")))

    def test_updates_and_plans(self):
        sources = self.pinned_large()
        self.assertIn("MB", self.good("mission", "plan", self.folder / "mission.yaml", "--imagery", sources).stdout)
        self.keys()
        self.good("cache", "build", *self.inputs(self.folder / "map.tif"), "--at", AT, "--key", self.folder / "signer.key.pem", "--out", self.folder / "first")
        updates = []
        for name, imagery in (("from-file", [self.folder / "large.tif", *FACTS]), ("from-object", [sources])):
            self.good("cache", "update", self.folder / "first", "--trust", self.folder / "root.json", "--mission", self.mission("next.yaml", sequence=2), "--imagery",
                      *imagery, "--at", AT, "--key", self.folder / "signer.key.pem", "--out", self.folder / name)
            updates.append(tree(self.folder / name))
        self.assertEqual(*updates)

    def test_elevation_models(self):
        cells = self.terrain_cells()
        mission = self.mission("hilly.yaml")
        mission.write_text(mission.read_text().replace("{mode: flat}", "{mode: dem}"))

        def build(dem, out, *more):
            self.good("cache", "build", "--mission", mission, "--imagery", self.folder / "map.tif", "--dem", *dem, *more, "--out", self.folder / out)
            return tree(self.folder / out)
        local = build(cells, "local")
        for cell in cells:
            self.store.put(f"dem/{cell.name}", cell.read_bytes())
        pinned = self.pin(*(f"s3://{BUCKET}/dem/{cell.name}" for cell in cells), name="dem.json", facts=[])
        self.gateway.bytes = 0
        self.assertEqual(local, build([pinned], "remote"))
        self.assertLess(self.gateway.bytes, sum(cell.stat().st_size for cell in cells), "a build reads what it needs")
        self.assertEqual(local, build([self.pin(*cells, name="files.json", facts=[])], "listed"))
        plan = self.folder / "plan"
        self.good("cache", "plan-shards", "--mission", mission, "--imagery", self.folder / "map.tif", "--dem", pinned, "--shards", 2, "--out", plan)
        pinned.unlink()  # the plan holds what is in it
        for shard in (1, 2):
            self.good("cache", "build", "--plan", plan, "--shard", f"{shard}/2")
        self.good("cache", "merge", "--plan", plan, "--out", self.folder / "merged")
        self.assertEqual(local, tree(self.folder / "merged"))

    def test_elevation_models_that_are_others(self):
        cells = self.terrain_cells()
        mission = self.mission("hilly.yaml")
        mission.write_text(mission.read_text().replace("{mode: flat}", "{mode: dem}"))

        def fails(dem, *mentions):
            self.fails(2, "cache", "build", "--mission", mission, "--imagery", self.folder / "map.tif", "--dem", dem, "--out", self.folder / "package",
                       mentions=mentions, leaves_nothing=self.folder / "package")
        url = f"s3://{BUCKET}/dem/{cells[0].name}"
        self.store.put(f"dem/{cells[0].name}", cells[0].read_bytes())
        fails(url, "not read unless", "nadir cache pin")
        pinned = self.pin(url, name="dem.json", facts=[])
        self.store.put(f"dem/{cells[0].name}", cells[1].read_bytes())
        fails(pinned, "changed since it was pinned", url)
        spoilt = bytearray(cells[0].read_bytes())
        for at in range(100_000, len(spoilt), 50_000):  # whatever blocks are read, behind the header
            spoilt[at] ^= 1
        self.store.put(f"dem/{cells[0].name}", bytes(spoilt))
        fails(pinned, "changed since it was pinned", url)
        self.gateway.fault = lambda handler: handler.answer(503) or True
        fails(pinned, url)
        self.gateway.fault = None
        listed = self.pin(*cells, name="files.json", facts=[])
        cells[1].write_bytes(cells[1].read_bytes()[:-1] + b"?")
        fails(listed, cells[1].name, "sha256")

    # --- STAC

    def terrain_cells(self):
        """Two cells of an elevation model, the seam in the middle of the map, with posts of one second for a third of a degree to each side."""
        second, side = 1 / 3600, 1200
        cells = []
        for number in range(2):
            raw, cell = self.folder / "cell.pgm", self.folder / f"cell-{number}.tif"
            noise = os.urandom(2 * side)
            raw.write_bytes(b"P5 %d %d 255\n" % (side, side) + b"".join(noise[y:y + side] for y in range(side)))
            west = (WEST + EAST) / 2 + (number - 1) * side * second
            north = NORTH + side / 2 * second
            subprocess.run(["gdal_translate", "-q", "-ot", "Float32", "-co", "TILED=YES", "-co", "GEOTIFF_VERSION=1.1", "-a_srs", "EPSG:4326", "-a_ullr",
                            *map(str, (west, north, west + side * second, north - side * second)), raw, cell], check=True)
            raw.unlink()
            cells.append(cell)
        return cells

    def item(self, href, **asset):
        return {**STAC, "id": pathlib.PurePosixPath(href).stem,
                "assets": {"image": {"href": href, "roles": ["data"], **asset}, "preview": {"href": "preview.png", "roles": ["thumbnail"]}}}

    def write(self, name, document):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(document))
        return path

    def collection(self, *hrefs, **more):
        return {"type": "Collection", "stac_version": "1.0.0", "id": "c", "description": "maps", "license": "CC-BY-4.0",
                "extent": {"spatial": {"bbox": [[-180, -90, 180, 90]]}, "temporal": {"interval": [[None, None]]}},
                "links": [{"rel": "root", "href": "./catalog.json"}, *({"rel": "item", "href": href} for href in hrefs)], **more}

    def test_collections_of_items(self):
        item = self.item("../map.tif", **{"file:checksum": "1220" + hashlib.sha256((self.folder / "map.tif").read_bytes()).hexdigest()})
        item["properties"] = {key: value for key, value in STAC["properties"].items() if key not in ("license", "providers")}
        self.write("items/map.json", item)
        collection = self.write("collection.json", self.collection("./items/map.json", providers=[{"name": "test"}]))
        package = self.build(collection, "package")
        licence = json.loads((package / "manifest.json").read_text())
        sources = next(a["tiles"]["sources"] for a in licence["artifacts"] if a["role"] == "imagery")
        self.assertEqual([{"licence": "CC-BY-4.0", "source": "test"}], sources)
        # The same collection on a web server, pinned.
        remote = self.pin(f"{self.url}/collection.json", facts=[])
        self.assertEqual(tree(package), tree(self.build(remote, "remote")))
        # Another file under its name.
        shutil.rmtree(package)
        item["assets"]["image"]["file:checksum"] = "1220" + "0" * 64
        self.write("items/map.json", item)
        self.build_fails(collection, "map.tif", "sha256 " + "0" * 64)
        self.fails(2, "cache", "pin", f"{self.url}/collection.json", mentions=["map.tif", "sha256 " + "0" * 64])

    def test_lists_that_are_none(self):
        self.build_fails(self.write("empty.json", {"type": "FeatureCollection", "features": []}), "names no imagery")
        self.build_fails(self.write("other.json", {"type": "Topology"}), "Feature", "Topology")
        self.build_fails(self.write("two.json", {**self.item("map.tif"), "assets": {"a": {"href": "map.tif"}, "b": {"href": "map.tif"}}}), "visual")
        self.build_fails(self.write("remote.json", self.collection(f"{self.url}/items/map.json")), "nadir cache pin")
        self.build_fails(self.write("unpinned.json", self.item(f"{self.url}/map.tif")), "not pinned", f"{self.url}/map.tif", "nadir cache pin")
        self.build_fails(f"{self.url}/map.tif", "nadir cache pin")
        loop = self.write("loop.json", self.collection("./loop.json"))
        self.build_fails(loop, "names no imagery")
        pinned = json.loads(self.pin(f"{self.url}/map.tif").read_text())
        asset = pinned["features"][0]["assets"]["data"]
        for member, value in (("file:size", 10 * BLOCK), ("nadir:block_sha256", "!"), ("nadir:block_bytes", 3), ("file:checksum", "1220ab"),
                              ("file:size", -1), ("href", 7)):
            broken = json.loads(json.dumps(pinned))
            broken["features"][0]["assets"]["data"] = {**asset, member: value}
            self.build_fails(self.write("broken.json", broken), "assets/data")

    def test_a_remote_list_names_nothing_on_this_machine(self):
        for href in ("file:///etc/passwd", "/vsizip/x.zip/map.tif", "ftp://host/map.tif"):
            self.write("evil.json", self.item(href))
            self.fails(2, "cache", "pin", f"{self.url}/evil.json", *FACTS, mentions=[href])
        self.write("evil.json", self.item("/../../etc/passwd"))
        self.fails(2, "cache", "pin", f"{self.url}/evil.json", *FACTS, mentions=[f"{self.url}/etc/passwd", "404"])

    # --- what fails

    def test_credentials_in_names(self):
        for name in ("https://user:geheim@host/map.tif", "https://host/map.tif?X-Amz-Signature=geheim", "s3://key:geheim@bucket/map.tif",
                     "/vsicurl/https://host/map.tif?sig=geheim"):
            result = self.fails(2, "cache", "pin", name, mentions=["environment"])
            self.assertNotIn("geheim", result.stdout + result.stderr)

    def test_no_object_no_permission_no_credentials_another_region(self):
        self.fails(2, "cache", "pin", f"s3://{BUCKET}/none.tif", mentions=["no such object", f"s3://{BUCKET}/none.tif", "404 (NoSuchKey)"])
        self.store.put("alps/large.tif", (self.folder / "large.tif").read_bytes())
        os.environ["AWS_SECRET_ACCESS_KEY"] = "another"
        self.fails(2, "cache", "pin", f"s3://{BUCKET}/alps/large.tif", mentions=["403 (SignatureDoesNotMatch)", "AWS_ACCESS_KEY_ID"])
        os.environ["AWS_SECRET_ACCESS_KEY"] = SECRET_KEY
        os.environ["AWS_REGION"] = "us-east-1"
        self.fails(2, "cache", "pin", f"s3://{BUCKET}/alps/large.tif", mentions=["another region", REGION, f"export AWS_REGION={REGION}"])
        os.environ["AWS_REGION"] = REGION
        os.environ["AWS_NO_SIGN_REQUEST"] = "YES"
        self.addCleanup(os.environ.pop, "AWS_NO_SIGN_REQUEST")
        self.fails(2, "cache", "pin", f"s3://{BUCKET}/alps/large.tif", mentions=["403 (AccessDenied)"])

    def test_credentials_from_the_aws_files(self):
        self.store.put("alps/large.tif", (self.folder / "large.tif").read_bytes())
        (self.folder / ".aws").mkdir()
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_REGION"):
            del os.environ[name]
        home = os.environ["HOME"]
        os.environ["HOME"] = str(self.folder)
        self.addCleanup(os.environ.__setitem__, "HOME", home)
        os.environ["CPL_AWS_WEB_IDENTITY_ENABLE"] = os.environ["CPL_AWS_AUTODETECT_EC2"] = "NO"
        (self.folder / ".aws/credentials").write_text(f"[default]\naws_access_key_id = {ACCESS_KEY}\naws_secret_access_key = {SECRET_KEY}\n")
        (self.folder / ".aws/config").write_text(f"[default]\nregion = {REGION}\n")
        self.pin(f"s3://{BUCKET}/alps/large.tif")

    def test_an_object_that_changes(self):
        sources = self.pinned_large()
        data = bytearray((self.folder / "large.tif").read_bytes())
        for at in range(len(data) // 3, 2 * len(data) // 3, 1 << 16):  # in the middle of the picture, where the mission is
            data[at] ^= 1
        self.store.put("alps/large.tif", bytes(data))
        self.build_fails(sources, "changed since it was pinned", f"s3://{BUCKET}/alps/large.tif", "sha256")
        self.store.put("alps/large.tif", bytes(data[:-1]))
        self.build_fails(sources, "changed since it was pinned", f"{len(data)} bytes", f"{len(data) - 1} bytes")
        # While it is read: the first answers are the old object's, the others the new one's.
        self.store.put("alps/large.tif", (self.folder / "large.tif").read_bytes())
        first = self.gateway.requests

        def later(handler):
            del handler
            return (lambda body: bytes([body[0] ^ 1]) + body[1:]) if self.gateway.requests > first + 3 else None
        self.gateway.fault = later
        self.build_fails(sources, "changed since it was pinned")
        # And while it is pinned.
        versions = iter(range(100))
        self.gateway.fault = lambda handler: handler.answer(
            206, bytes(8 * BLOCK), Content_Range="bytes {}-{}/{}".format(*(lambda a: (a, a + 8 * BLOCK - 1))(int(handler.headers["Range"][6:].split("-")[0])), 32 * BLOCK),
            ETag=f'"{next(versions)}"') or True
        self.fails(2, "cache", "pin", f"s3://{BUCKET}/alps/large.tif", mentions=["changed while it was pinned"])

    def test_servers_that_fail(self):
        sources = self.pinned_large()

        def once(fault):
            left = [1]

            def first(handler):
                if left:
                    left.pop()
                    return fault(handler)
                return None
            return first

        def cut_off(handler):
            handler.send_response(206)
            handler.send_header("Content-Length", str(BLOCK))
            handler.send_header("Content-Range", f"bytes 0-{BLOCK - 1}/{2 * BLOCK}")
            handler.end_headers()
            handler.wfile.write(b"x" * 1000)
            handler.close_connection = True
            return True

        def busy(handler):
            handler.answer(503, error_document("SlowDown"))
            return True

        def drip(handler):
            handler.send_response(206)
            handler.send_header("Content-Length", str(BLOCK))
            handler.end_headers()
            with contextlib.suppress(OSError):
                for _ in range(40):
                    handler.wfile.write(b"x")
                    time.sleep(0.2)
            handler.close_connection = True
            return True

        def flood(handler):
            handler.answer(206, bytes(9 * BLOCK), Content_Range=f"bytes 0-{9 * BLOCK - 1}/{9 * BLOCK}")
            return True

        def elsewhere(handler):
            handler.answer(206, bytes(BLOCK), Content_Range=f"bytes {BLOCK}-{2 * BLOCK - 1}/{2 * BLOCK}")
            return True

        def whole(handler):
            handler.answer(200, bytes(20 * BLOCK))
            return True

        for fault, *mentions in ((cut_off, "s3://"), (busy, "503 (SlowDown)"), (drip, "4096 bytes/s"), (flood, "another part"), (elsewhere, "another part"),
                                 (whole, "no parts")):
            with self.subTest(fault.__name__):
                self.gateway.fault = fault
                self.build_fails(sources, *mentions)
        for fault in (cut_off, busy):
            with self.subTest(f"{fault.__name__}, once"):
                self.gateway.fault = once(fault)
                shutil.rmtree(self.build(sources, "package"))
        self.gateway.fault = None
        with socket.socket() as closed:
            closed.bind(("127.0.0.1", 0))
            os.environ["AWS_S3_ENDPOINT"] = f"127.0.0.1:{closed.getsockname()[1]}"
            self.build_fails(sources, f"s3://{BUCKET}/alps/large.tif", "network")

    def test_servers_that_lead_elsewhere(self):
        for target, mention in (("file:///etc/passwd", "file:///etc/passwd"), ("http://169.254.169.254/latest/meta-data", "169.254.169.254"),
                                ("http://[fe80::1]/map.tif", "fe80::1"), ("http://[::ffff:169.254.169.254]/", "169.254.169.254"), ("http://0.0.0.0/", "0.0.0.0"),
                                ("gopher://127.0.0.1/", "gopher"), ("/loop.tif", "loop.tif")):
            with self.subTest(target):
                self.web.answers["/loop.tif"] = redirect_to(target)
                self.fails(2, "cache", "pin", f"{self.url}/loop.tif", mentions=["leads to", mention])
        self.web.answers["/moved.tif"] = redirect_to(f"{self.url}/large.tif")
        self.pin(f"{self.url}/moved.tif")
        self.store.put("alps/large.tif", b"x")
        self.gateway.fault = lambda handler: redirect_to(f"{self.url}/large.tif")(handler) or True
        self.fails(2, "cache", "pin", f"s3://{BUCKET}/alps/large.tif", mentions=["302"])

    def test_what_is_no_raster(self):
        (self.folder / "text.tif").write_text("no raster at all")
        self.fails(2, "cache", "pin", f"{self.url}/text.tif", mentions=["text.tif", "cannot be opened"])
        (self.folder / "evil.tif").write_text(f'<VRTDataset rasterXSize="16" rasterYSize="16"><VRTRasterBand dataType="Byte" band="1"><SimpleSource>'
                                              f'<SourceFilename relativeToVRT="0">{self.folder}/map.tif</SourceFilename><SourceBand>1</SourceBand></SimpleSource>'
                                              "</VRTRasterBand></VRTDataset>")
        self.fails(2, "cache", "pin", f"{self.url}/evil.tif", mentions=["evil.tif", "cannot be opened"])
        (self.folder / "empty.tif").write_bytes(b"")
        self.fails(2, "cache", "pin", f"{self.url}/empty.tif")


if __name__ == "__main__":
    main()
