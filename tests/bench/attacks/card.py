"""Who sells an SD card, or writes on one: packages, roots, missions, maps and recordings that are not what they seem."""
import json
import os
import shutil
import sqlite3
import struct
import time

from .registry import Measured, attack
from .shared import day, sign
from .watching import Listener, Opened

SIDECARS = "18 AS zoom_level, 137259 AS tile_column, value AS tile_row, {} AS sha256, '' AS source, '' AS captured_at, " \
           "1 AS gsd_mm, 1 AS ce90_mm, '' AS trust, '' AS sector, 1 AS valid_ppm, NULL AS mask"
COUNTING = "(WITH RECURSIVE c(value) AS (SELECT 1 UNION ALL SELECT value + 1 FROM c LIMIT 100000) SELECT value FROM c)"
GEO_TAGS = (33550, 33922, 34735, 34736, 34737)


def verify(scene, package, *more, root=None):
    return scene.run("nadir", "cache", "verify", package, "--trust", root or scene.shared.root, *more)


def check(scene, package, *more):
    return scene.run("nadird", "--package", package, "--trust", scene.shared.root, "--airframe", "mini-07", "--check", *more)


def imagery(package):
    return next(path for path in (package / "imagery").iterdir() if path.suffix in (".mbtiles", ".tif"))


def manifest(package):
    return json.loads((package / "manifest.json").read_text())


def code_of(ran):
    """The codes of the findings, as the program prints them."""
    return ", ".join(dict.fromkeys(word.strip(":,") for line in ran.said.splitlines() for word in line.split()[:3]
                                   if "." in word and word.replace(".", "").replace("_", "").replace(":", "").isalpha())) or "rejected"


def put_view(path, blob):
    """The tiles' sidecars become code that runs when they are read."""
    with sqlite3.connect(path) as database:
        database.execute("DROP TABLE nadir_sidecars")
        database.execute(f"CREATE VIEW nadir_sidecars AS SELECT {SIDECARS.format(blob)} FROM {COUNTING}")
    with sqlite3.connect(path) as database:
        database.execute("VACUUM")
    database.close()


def view_is_in(path):
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as database:
        return database.execute("SELECT type FROM sqlite_schema WHERE name = 'nadir_sidecars'").fetchone() == ("view",)


@attack("H6", memory_mb=300)
def view_of_huge_blobs(scene):
    """The tile table's sidecars are a view over 100 000 blobs of 30 MB each; the file has another size than was signed."""
    package = scene.shared.package(scene.folder)
    put_view(imagery(package), "zeroblob(30000000)")
    scene.attacked(view_is_in(imagery(package)), "the view is not in the file")
    return scene.rejected(check(scene, package), "artifact.size")


@attack("H6", memory_mb=300)
def view_in_a_file_of_the_signed_size(scene):
    """The same view, and the file is padded to exactly the size that was signed."""
    package = scene.shared.package(scene.folder)
    size = imagery(package).stat().st_size
    put_view(imagery(package), "zeroblob(30000000)")
    with open(imagery(package), "r+b") as file:
        file.truncate(size)
    scene.attacked(imagery(package).stat().st_size == size and view_is_in(imagery(package)), "another size, or no view")
    ran = check(scene, package)
    scene.rejected(ran)
    scene.holds("code that would run" in ran.said or "view" in ran.said, f"the view is not named: {ran.said[:150]}")
    return ran.line("view") or ran.line("code that")


@attack("H6", memory_mb=300)
def query_without_end(scene):
    """A view whose query never ends, in a tile set that somebody else made."""
    path = scene.folder / "other.mbtiles"
    shutil.copy(imagery(scene.shared.built()), path)
    with sqlite3.connect(path) as database:
        database.execute("ALTER TABLE tiles RENAME TO hidden")
        database.execute("CREATE VIEW tiles AS WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) "
                         "SELECT zoom_level, tile_column, tile_row, tile_data FROM hidden, c WHERE n < 0")
    database.close()
    mission = scene.shared.built().parent / "mission.yaml"
    ran = scene.run("nadir", "cache", "validate", path, "--mission", mission)
    scene.attacked("sqlite" in ran.said.lower() or "database" in ran.said or "view" in ran.said, ran.said[:150])
    scene.holds(ran.code in (1, 2), f"exit code {ran.code}")
    return ran.line("sqlite") or ran.said


@attack(memory_mb=300)
def text_of_a_gigabyte_in_metadata(scene):
    """A tile set's metadata has a view that gives one text of 900 MB."""
    path = scene.folder / "other.mbtiles"
    shutil.copy(imagery(scene.shared.built()), path)
    with sqlite3.connect(path) as database:
        database.execute("DROP TABLE metadata")
        database.execute("CREATE VIEW metadata AS SELECT 'name' AS name, hex(zeroblob(450000000)) AS value")
    database.close()
    ran = scene.run("nadir", "cache", "inspect", path)
    scene.attacked(path.stat().st_size < 1_000_000, "the file is not small")
    scene.holds(ran.code in (1, 2), f"exit code {ran.code}: {ran.said[:100]}")
    return ran.said[:110]


def huge_cog(like, path, tiles_across, masks, size=None):
    """A COG with the geo tags of an honest one whose images name `tiles_across`² blocks each, all by one table."""
    honest = like.read_bytes()
    (first,) = struct.unpack_from("<I", honest, 4)
    (count,) = struct.unpack_from("<H", honest, first)
    tags = {}
    for i in range(count):
        tag, kind, number, value = struct.unpack_from("<HHI4s", honest, first + 2 + 12 * i)
        length = number * {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 12: 8}.get(kind, 1)
        at = struct.unpack("<I", value)[0]
        tags[tag] = (kind, number, value[:length] if length <= 4 else honest[at:at + length])
    side, blocks = tiles_across * 256, tiles_across * tiles_across
    body, table = bytearray(b"II*\0\0\0\0\0"), 8
    body += b"\x01\x01" * blocks  # offsets and sizes of all blocks, of two bytes each: 257 bytes at 257
    link = 4
    for image in range(masks + 1):
        own = dict(tags)
        own[256] = own[257] = (4, 1, struct.pack("<I", side))
        own[322] = own[323] = (4, 1, struct.pack("<I", 256))
        own[324] = own[325] = (3, blocks, None)
        if image:
            own[254] = (4, 1, struct.pack("<I", 4))
            own = {tag: value for tag, value in own.items() if tag not in GEO_TAGS}
            own[258] = own[277] = (3, 1, struct.pack("<HH", 1, 0))
            own[262] = (3, 1, struct.pack("<HH", 4, 0))
            own[259] = (3, 1, struct.pack("<HH", 8, 0))
        entries = bytearray()
        for tag in sorted(own):
            kind, number, value = own[tag]
            if value is None:
                place = struct.pack("<I", table)
            elif len(value) <= 4:
                place = value.ljust(4, b"\0")
            else:
                place = struct.pack("<I", len(body))
                body += value + bytes(len(value) % 2)
            entries += struct.pack("<HHI", tag, kind, number) + place
        struct.pack_into("<I", body, link, len(body))
        body += struct.pack("<H", len(own)) + entries
        link = len(body)
        body += bytes(4)
    if size is not None:
        assert len(body) <= size, (len(body), size)
        body += bytes(size - len(body))
    path.write_bytes(body)


@attack("H6", memory_mb=300)
def cog_of_a_million_blocks(scene):
    """A COG of 2 MB whose images each name a million blocks by one table that they share."""
    path = scene.folder / "map.tif"
    huge_cog(imagery(scene.shared.built("cog")), path, 1000, masks=40)
    scene.attacked(path.stat().st_size < 2_200_000, "the file is larger than 2 MB")
    ran = scene.run("nadir", "cache", "inspect", path)  # it may be shown: a question of memory and time
    return ran.said[:110]


@attack("H6", memory_mb=300)
def cog_of_the_signed_size_with_more_tiles(scene):
    """The COG of a signed package is replaced by one of the same size that names 400 times the tiles."""
    package = scene.shared.package(scene.folder, container="cog")
    cog = imagery(package)
    size = cog.stat().st_size
    huge_cog(imagery(scene.shared.built("cog")), cog, 450, masks=20, size=size)
    scene.attacked(cog.stat().st_size == size, "another size")
    return code_of_rejected(scene, check(scene, package))


def code_of_rejected(scene, ran, code=1):
    scene.rejected(ran, code=code)
    return code_of(ran)


@attack("M1")
def mission_swapped_after_its_hash(scene):
    """mission.yaml is replaced the moment that it is opened for hashing; whoever opens it again parses the attacker's."""
    package = scene.shared.package(scene.folder)
    path, forged = package / "mission" / "mission.yaml", scene.folder / "forged.yaml"
    forged.write_text("this: [is, not, a mission\n")
    with Opened(path, lambda: os.replace(forged, path)) as opened:
        ran = verify(scene, package)
    scene.attacked(opened.count and not forged.exists(), "mission.yaml was not opened")
    scene.holds(ran.code == 0 or "artifact" in ran.said, f"the attacker's bytes were parsed: {ran.said[:120]}")
    scene.holds(opened.count == 1, f"mission.yaml was opened {opened.count} times")
    return f"opened once; {'accepted as signed' if ran.code == 0 else code_of(ran)}"


@attack("M1")
def manifest_swapped_after_its_signature(scene):
    """manifest.json is replaced the moment that it is opened for its signature."""
    package = scene.shared.package(scene.folder)
    path, forged = package / "manifest.json", scene.folder / "forged.json"
    forged.write_text(path.read_text().replace('"mini-07"', '"mini-66"'))
    with Opened(path, lambda: os.replace(forged, path)) as opened:
        ran = verify(scene, package, "--airframe", "mini-66")
    scene.attacked(opened.count and not forged.exists(), "manifest.json was not opened")
    scene.rejected(ran, "airframe.mismatch", "signature.invalid")
    return code_of(ran)


@attack("M1")
def folder_flipped_while_it_is_read(scene):
    """`current` is moved to another signed package the moment that the first one's manifest is opened."""
    packages = scene.folder / "packages"
    packages.mkdir()
    first = scene.shared.package(packages, "first")
    scene.shared.package(packages, "second", series="other", sequence=7)
    (packages / "current").symlink_to("first")
    (packages / "new").symlink_to("second")
    with Opened(first / "manifest.json", lambda: os.replace(packages / "new", packages / "current")) as opened:
        ran = verify(scene, packages / "current", "--depth", "full")
    scene.attacked(opened.count and (packages / "current").resolve().name == "second", "the link was not moved")
    scene.holds(ran.code == 0 and "series small" in ran.said, f"files of two packages were mixed: {ran.said[:150]}")
    return "the first package, wholly"


def pipe_instead(scene, where, code, *words):
    """Replaces a file by a FIFO that nobody writes to; judged by how soon the check ends."""
    package = scene.shared.package(scene.folder)
    path = package / where
    path.unlink()
    os.mkfifo(path)
    scene.attacked(path.is_fifo(), "there is no pipe")
    ran = check(scene, package)
    scene.rejected(ran, *words, code=code)
    scene.holds(ran.seconds < 10, f"it took {ran.seconds:.0f} s")
    return code_of(ran)


@attack("M11", seconds=30)
def pipe_instead_of_the_manifest(scene):
    """manifest.json is a pipe that nobody writes to."""
    return pipe_instead(scene, "manifest.json", 1)


@attack("M11", seconds=30)
def pipe_instead_of_the_mission(scene):
    """mission.yaml is a pipe that nobody writes to."""
    return pipe_instead(scene, "mission/mission.yaml", 1)


@attack("M11", seconds=30)
def pipe_instead_of_the_imagery(scene):
    """The tile set is a pipe that nobody writes to."""
    return pipe_instead(scene, "imagery/base.mbtiles", 1)


@attack("M11", seconds=30)
def pipe_instead_of_the_root(scene):
    """The root of trust is a pipe that nobody writes to; SIGTERM must end the program all the same."""
    os.mkfifo(scene.folder / "root.json")
    started = scene.start("nadird", "--package", scene.shared.built(), "--trust", scene.folder / "root.json", "--airframe", "mini-07", "--check")
    scene.wait_for(lambda: not started.running(), 6)
    hung = started.running()
    ran = scene.end(started, patience_s=5)
    scene.attacked(hung or ran.said, "nothing was said")
    scene.holds(not hung, "it waits for the pipe")
    return scene.rejected(ran, "root.json", code=2)


@attack("L7", memory_mb=200, seconds=30)
def mission_of_a_hundred_thousand_keys(scene):
    """A mission file of 1 MiB that is nothing but keys."""
    path = scene.folder / "mission.yaml"
    path.write_text("".join(f"k{i:06}: 1\n" for i in range(95_000)))
    scene.attacked(path.stat().st_size > 1_000_000, "the file is small")
    ran = scene.run("nadir", "mission", "check", path)
    scene.holds(ran.code in (1, 2), f"exit code {ran.code}")
    scene.holds(ran.cpu_s < 4, f"it took {ran.cpu_s:.0f} s of a core")
    scene.holds(len(ran.said) < 20_000, f"{len(ran.said)} bytes of messages")
    return ran.said[:110]


@attack(memory_mb=200)
def yaml_of_aliases(scene):
    """A mission file in which each of thirty lists holds the one before nine times (the billion laughs)."""
    lines = ["a0: &a0 [lol, lol, lol, lol, lol, lol, lol, lol, lol]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 30)]
    path = scene.folder / "mission.yaml"
    path.write_text("\n".join(lines) + "\n")
    scene.attacked("*a28" in path.read_text(), "no aliases")
    return scene.rejected(scene.run("nadir", "mission", "check", path), "mission.schema")


@attack(memory_mb=300)
def yaml_of_brackets(scene):
    """A mission file of 500 000 opening brackets."""
    path = scene.folder / "mission.yaml"
    path.write_text("route: " + "[" * 500_000)
    return scene.rejected(scene.run("nadir", "mission", "check", path), "mission.schema")


def called(scene, listener, *command):
    """The command ends as wrong usage or rejected, and nobody has called the port."""
    ran = scene.run("nadir", *command)
    scene.holds(ran.code in (1, 2), f"exit code {ran.code}")
    scene.holds(listener.calls == 0, f"the network was asked: {listener.received[:60]}")
    return ran.said


@attack("L4")
def map_that_is_a_web_service(scene):
    """A file map.tif that describes a WMTS server; GDAL goes by content, not by name."""
    shutil.copy(scene.shared.map.with_suffix(".json"), scene.folder / "map.json")
    mission = scene.shared.built().parent / "mission.yaml"
    with Listener() as listener:
        (scene.folder / "map.tif").write_text(f"<GDAL_WMTS><GetCapabilitiesUrl>http://127.0.0.1:{listener.port}/wmts"
                                              "</GetCapabilitiesUrl></GDAL_WMTS>")
        return called(scene, listener, "cache", "build", "--mission", mission, "--imagery", scene.folder / "map.tif", "--key",
                      scene.shared.keys / "signer.key.pem", "--out", scene.folder / "package")[:110]


@attack("L4")
def drawing_that_fetches(scene):
    """A route plan.kml that is an OGR VRT over a server."""
    with Listener() as listener:
        (scene.folder / "plan.kml").write_text(
            f"<OGRVRTDataSource><OGRVRTLayer name=\"route\"><SrcDataSource>/vsicurl/http://127.0.0.1:{listener.port}/r.geojson"
            "</SrcDataSource><SrcLayer>route</SrcLayer></OGRVRTLayer></OGRVRTDataSource>")
        return called(scene, listener, "mission", "import", scene.folder / "plan.kml", "--id", "x", "--out",
                      scene.folder / "mission.yaml")[:110]


@attack("L4")
def map_with_a_remote_overview(scene):
    """A sound map.tif whose .aux.xml names its overviews on a server."""
    for name in ("map.tif", "map.json"):
        shutil.copy(scene.shared.map.parent / name, scene.folder / name)
    mission = scene.shared.built().parent / "mission.yaml"
    with Listener() as listener:
        (scene.folder / "map.tif.aux.xml").write_text(
            "<PAMDataset><Metadata domain=\"OVERVIEWS\"><MDI key=\"OVERVIEW_FILE\">"
            f"/vsicurl/http://127.0.0.1:{listener.port}/o.tif</MDI></Metadata></PAMDataset>")
        ran = scene.run("nadir", "cache", "build", "--mission", mission, "--imagery", scene.folder / "map.tif", "--key",
                        scene.shared.keys / "signer.key.pem", "--out", scene.folder / "package")
        scene.holds(listener.calls == 0, f"the network was asked: {listener.received[:60]}")
    return ran.line("aux.xml") or f"exit code {ran.code}, nothing was fetched"


@attack("L3")
def file_name_that_writes_lines(scene):
    """A file in the package whose name has a line break and "accepted", and an escape sequence that clears the screen."""
    package = scene.shared.package(scene.folder)
    (package / "imagery" / "x\naccepted\x1b[2J\x1b[1;1H").write_text("x")
    ran = verify(scene, package)
    scene.rejected(ran, "artifact.unexpected")
    scene.holds("accepted" not in [line.strip() for line in ran.said.splitlines()], "a file's name became a line of the output")
    scene.holds("\x1b[2J" not in ran.said, "an escape sequence reached the terminal")
    return "artifact.unexpected, on one line"


@attack("L6")
def path_beyond_the_systems_limit(scene):
    """A package path of 6000 bytes, and a name of 300."""
    ran = check(scene, "/" + "a/" * 3000)
    scene.holds(ran.code in (1, 2), f"exit code {ran.code}")
    again = check(scene, scene.folder / ("b" * 300))
    scene.holds(again.code in (1, 2), f"exit code {again.code}")
    for said in (ran.said, again.said):
        scene.holds("defect" not in said and "bug" not in said, f"called a fault of the program: {said[-120:]}")
    return again.line("b" * 20)[-80:] or again.said[:100]


@attack("L6")
def folder_without_permission(scene):
    """A folder of the package that the service's user may not read."""
    package = scene.shared.package(scene.folder)
    for folder in (scene.shared.folder, scene.folder.parent, scene.folder):
        folder.chmod(0o755)
    (package / "mission").chmod(0)
    if os.getuid() != 0:
        ran = check(scene, package)
    else:  # root may read everything: without that capability it is a user like others
        started = Measured(["setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-all", "--reuid=nobody", "--regid=nogroup",
                            "--clear-groups", scene.program("nadird"), "--package", package, "--trust", scene.shared.root,
                            "--airframe", "mini-07", "--check"], scene.folder)
        ran = started.finish(20)
        scene.peak_mb, scene.code = max(scene.peak_mb, ran.peak_mb), ran.code
    (package / "mission").chmod(0o755)
    scene.attacked("denied" in ran.said or "ermission" in ran.said, ran.said[:150])
    scene.holds(ran.code in (1, 2), f"exit code {ran.code}")
    scene.holds("defect" not in ran.said and "bug" not in ran.said, "called a fault of the program")
    return ran.line("enied")[:110]


@attack()
def one_byte_of_a_tile_flipped(scene):
    """One bit of one tile's image is flipped, nothing else."""
    package = scene.shared.package(scene.folder)
    with sqlite3.connect(imagery(package)) as database:
        row, data = database.execute("SELECT rowid, tile_data FROM tiles LIMIT 1").fetchone()
        data = bytearray(data)
        data[len(data) // 2] ^= 1
        database.execute("UPDATE tiles SET tile_data = ? WHERE rowid = ?", (bytes(data), row))
    database.close()
    scene.attacked(imagery(package).read_bytes() != imagery(scene.shared.built()).read_bytes(), "nothing changed")
    return scene.rejected(verify(scene, package, "--depth", "full"), "artifact.hash")


@attack()
def two_tiles_exchanged(scene):
    """Two genuine tiles and their sidecars change places, so that the aircraft matches the wrong ground."""
    package = scene.shared.package(scene.folder)
    with sqlite3.connect(imagery(package)) as database:
        one, two = database.execute("SELECT tile_column, tile_row FROM tiles WHERE zoom_level = 18 LIMIT 2").fetchall()
        for table in ("tiles", "nadir_sidecars"):
            for old, new in ((one, (1, 1)), (two, one), ((1, 1), two)):
                database.execute(f"UPDATE {table} SET tile_column = ?, tile_row = ? WHERE zoom_level = 18 AND tile_column = ? "
                                 "AND tile_row = ?", (*new, *old))
        database.commit()
        database.execute("VACUUM")
    database.close()
    size = imagery(scene.shared.built()).stat().st_size
    scene.attacked(imagery(package).stat().st_size <= size, "it has become larger")
    os.truncate(imagery(package), size)
    return scene.rejected(check(scene, package), "tiles.root", "artifact.hash")


@attack()
def younger_dates_in_the_sidecars(scene):
    """Old imagery is given the date of yesterday in its sidecars."""
    package = scene.shared.package(scene.folder)
    with sqlite3.connect(imagery(package)) as database:
        database.execute("UPDATE nadir_sidecars SET captured_at = ?", (day(-1),))
    database.close()
    return scene.rejected(check(scene, package), "tiles.root", "artifact.size")


@attack()
def imagery_of_another_package(scene):
    """Mix and match: the tile set of one signed package in another."""
    package = scene.shared.package(scene.folder)
    with sqlite3.connect(imagery(package)) as database:
        database.execute("DELETE FROM tiles WHERE rowid % 2")
    database.close()
    return scene.rejected(check(scene, package), "tiles", "artifact")


@attack()
def manifest_edited(scene):
    """One more airframe is written into a signed manifest."""
    package = scene.shared.package(scene.folder)
    path = package / "manifest.json"
    path.write_text(path.read_text().replace('"mini-07"', '"mini-07",\n  "mini-66"'))
    scene.attacked("mini-66" in manifest(package)["airframes"], "no such airframe in it")
    return scene.rejected(verify(scene, package, "--airframe", "mini-66"), "signature.invalid")


@attack()
def signed_by_an_unknown_key(scene):
    """A whole package, signed with a key of the attacker's own."""
    package = scene.shared.package(scene.folder, key=scene.shared.keys / "untrusted.key.pem")
    return scene.rejected(check(scene, package), "key.unknown", "signature.missing")


@attack()
def stolen_tile_key_signs_a_package(scene):
    """One stolen airframe key signs a map package for the whole fleet."""
    package = scene.shared.package(scene.folder, key=scene.shared.keys / "tile.key.pem", airframes="mini-07, mini-08")
    return scene.rejected(check(scene, package), "key.unknown", "signature.missing")


@attack()
def signature_as_another_type(scene):
    """A genuine signature of an airframe signer over other bytes, shown as a manifest's."""
    package = scene.shared.package(scene.folder)
    path = package / "manifest.sig"
    envelope = json.loads(path.read_text())
    kind = "application/vnd.nadir.airframe.v1+json"
    envelope["payloadType"] = kind
    envelope["signatures"][0]["sig"] = sign(scene.shared.keys / "signer.key.pem", kind, (package / "manifest.json").read_bytes())
    path.write_text(json.dumps(envelope))
    return scene.rejected(check(scene, package), "signature.invalid", "signature.missing")


@attack()
def signature_twice_for_a_threshold(scene):
    """The root asks for two signers; one of them signs twice, the second time under the other's key id."""
    keys, folder = scene.shared.keys, scene.folder
    scene.run("nadir", "keys", "root", "--root-key", keys / "root.key.pem", "--package-signer", keys / "signer.pub.pem",
              "--package-signer", keys / "untrusted.pub.pem", "--threshold", "2", "--expires", day(900)[:10], "--out", folder / "two.json")
    package = scene.shared.package(folder)
    path = package / "manifest.sig"
    envelope = json.loads(path.read_text())
    known = json.loads((folder / "two.json").read_text())["signed"]["roles"]["package-signer"]["keyids"]
    own = envelope["signatures"][0]
    other = next(name for name in known if name != own["keyid"])
    envelope["signatures"] = [own, dict(own, keyid=other), dict(own)]
    path.write_text(json.dumps(envelope))
    scene.attacked(own["keyid"] in known, "the first signer is not in the root")
    return scene.rejected(verify(scene, package, root=folder / "two.json"), "signature")


@attack()
def own_root_in_the_package(scene):
    """The package brings a next root of trust that appoints the attacker, signed by the attacker."""
    keys = scene.shared.keys
    package = scene.shared.package(scene.folder, key=keys / "untrusted.key.pem")
    root = json.loads(scene.shared.root.read_text())
    root["signed"]["version"] = 2
    root["signed"]["roles"]["package-signer"]["keyids"] = [json.loads((package / "manifest.sig").read_text())["signatures"][0]["keyid"]]
    (package / "root").mkdir()
    (package / "root" / "2.root.json").write_text(json.dumps(root))
    ran = check(scene, package)
    return scene.rejected(ran, "root.invalid", "signature", "key.unknown")


@attack()
def older_package_put_back(scene):
    """Rollback: the package of last week, still signed, on an aircraft that has flown a newer one."""
    state = scene.folder / "state.json"
    newer = check(scene, scene.shared.built(sequence=2), "--state", state)
    scene.attacked(newer.code == 0 and state.exists(), f"the newer one was not accepted: {newer.said[:100]}")
    return scene.rejected(check(scene, scene.shared.built(), "--state", state), "package.rollback")


@attack()
def expired_package(scene):
    """Freeze: a package whose date has passed, kept on the card."""
    return scene.rejected(check(scene, scene.shared.built(), "--at", day(90)), "package.expired")


@attack()
def package_of_another_aircraft(scene):
    """A package that was made for another airframe."""
    return scene.rejected(check(scene, scene.shared.built(airframes="mini-08")), "airframe.mismatch")


@attack("Also")
def manifest_that_no_parser_likes(scene):
    """manifest.json, properly signed, is a list, then broken UTF-8, then twice the same key, then a number of 400 digits."""
    answers = []
    for body in (b"[]", b'{"a": "\xff\xfe"}', b'{"schema": "x", "schema": "y"}', b'{"a": ' + b"9" * 400 + b"}", b"\0" * 9, b'{"schema": 1e999}'):
        package = scene.shared.package(scene.folder, f"package-{len(answers)}")
        (package / "manifest.json").write_bytes(body)
        scene.shared.sign_manifest(package)
        answers.append(scene.rejected(check(scene, package), "manifest.schema"))
    return f"{len(answers)} times {answers[0]}, no parser's own words"


@attack(memory_mb=200)
def manifest_of_brackets(scene):
    """A signed manifest of 200 000 opening brackets."""
    package = scene.shared.package(scene.folder)
    (package / "manifest.json").write_text("[" * 200_000)
    scene.shared.sign_manifest(package)
    return scene.rejected(check(scene, package), "manifest.schema")


@attack(memory_mb=200)
def endless_manifest(scene):
    """A manifest of 4 GB that needs no room on the card (a sparse file)."""
    package = scene.shared.package(scene.folder)
    os.truncate(package / "manifest.json", 4 << 30)
    scene.attacked((package / "manifest.json").stat().st_size > 1e9, "it is small")
    return scene.rejected(check(scene, package), "manifest", "signature")


@attack()
def link_to_a_secret(scene):
    """mission.yaml is a link to a secret of the system: its text must not appear in a message."""
    secret = scene.folder / "secret"
    secret.write_text("root:5f4dcc3b5aa765d61d8327deb882cf99:\n  - : [\n")
    package = scene.shared.package(scene.folder)
    (package / "mission" / "mission.yaml").unlink()
    (package / "mission" / "mission.yaml").symlink_to(secret)
    ran = check(scene, package)
    scene.rejected(ran)
    scene.holds("5f4dcc" not in ran.said, "the secret is shown")
    return code_of(ran)


@attack()
def name_that_leads_out(scene):
    """A signed manifest that names ../../etc/passwd, /etc/passwd and a name that differs in case only."""
    answers = []
    for name in ("../../../../etc/passwd", "/etc/passwd", "imagery/../../x", "Imagery/base.mbtiles"):
        package = scene.shared.package(scene.folder, f"package-{len(answers)}")
        document = manifest(package)
        document["artifacts"].insert(0, dict(document["artifacts"][1], path=name))
        (package / "manifest.json").write_text(json.dumps(document, indent=1))
        scene.shared.sign_manifest(package)
        ran = check(scene, package)
        scene.holds("root:x:0" not in ran.said, "a file outside is shown")
        answers.append(scene.rejected(ran, "manifest.path", "manifest.schema"))
    return ", ".join(dict.fromkeys(answers))


@attack()
def hot_journal(scene):
    """A journal beside the tile set that SQLite would play back into it."""
    package = scene.shared.package(scene.folder)
    path = imagery(package)
    before = path.read_bytes()
    header = struct.pack(">8sIIIIII", b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", 1, 0, len(before) // 4096, 512, 4096, 0)
    journal = header.ljust(512, b"\0") + struct.pack(">I", 2) + b"\xaa" * 4096 + struct.pack(">I", 0)
    path.with_name(path.name + "-journal").write_bytes(journal)
    ran = check(scene, package)
    scene.holds(path.read_bytes() == before, "the journal was played back into the tile set")
    return scene.rejected(ran, "artifact.unexpected", "sqlite.journal")


@attack("L5")
def recording_with_the_last_number(scene):
    """A recording named 4294967295.flight.mcap in the recorder's folder: the next number must not wrap around."""
    from .aircraft import Aircraft
    record = scene.folder / "record"
    record.mkdir()
    (record / "4294967295.flight.mcap").write_bytes(b"\x89MCAP0\r\n")
    with Aircraft(scene, "--record", record) as aircraft:
        aircraft.has_package()
        own = scene.wait_for(lambda: [path.name for path in record.iterdir() if path.name.startswith("0000")], 10,
                             "nothing was recorded")
    scene.holds((record / "4294967295.flight.mcap").exists() and not (record / "000000.flight.mcap").exists(), "the number wrapped")
    return f"recorded as {sorted(own)[0]}"


@attack(memory_mb=300)
def recording_of_lengths(scene):
    """A recording whose chunk claims to be 60 GB when decompressed, and whose record is longer than the file."""
    path = scene.folder / "000001.flight.mcap"
    magic = b"\x89MCAP0\r\n"
    header = b"\x01" + struct.pack("<Q", 8) + bytes(8)
    chunk = struct.pack("<QQQI", 0, 1, 60 << 30, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", 8) + bytes(8)
    path.write_bytes(magic + header + b"\x06" + struct.pack("<Q", len(chunk)) + chunk + b"\x05" + struct.pack("<Q", 1 << 60))
    ran = scene.run("nadir", "recorder", "verify", scene.folder)
    scene.attacked("recorder" in ran.said, ran.said[:100])
    return scene.rejected(ran, "recorder.chunk", "recorder.format", "recorder.truncated")


@attack("Also")
def nothing_left_behind_after_a_mere_read(scene):
    """A verification is interrupted: the message must not speak of output that it never writes."""
    package = scene.shared.package(scene.folder)
    os.truncate(imagery(package), 0)
    with open(imagery(package), "wb") as file:
        file.truncate(30 << 30)
    document = manifest(package)
    document["artifacts"][0]["size"] = 30 << 30
    (package / "manifest.json").write_text(json.dumps(document, indent=1))
    scene.shared.sign_manifest(package)
    started = scene.start("nadir", "cache", "verify", package, "--trust", scene.shared.root, "--depth", "full")
    time.sleep(1.5)
    scene.attacked(started.running(), f"it was done before: {started.text()[:150]}")
    ran = scene.end(started, patience_s=10)
    scene.holds("left behind" not in ran.said, f"it says: {ran.said.strip()[-100:]}")
    scene.holds(ran.code == 130, f"exit code {ran.code}")
    return ran.said.strip()[-60:]
