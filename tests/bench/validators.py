#!/usr/bin/env python3
"""Validators on damaged tile sets, side by side: nadir cache validate, mbtiles validate (martin), pmtiles
convert + verify, rio cogeo validate --strict, GDAL's validate_cloud_optimized_geotiff.py, gdalinfo, SQLite's
integrity_check. Prints Markdown tables; tools that are not installed are
reported as "not run". Packages that Nadir made are in them too.

  tests/bench/validators.py [NADIR]        tools from PATH: mbtiles, pmtiles, rio; python3 of Debian with GDAL"""
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "third_party"))
from damages import DAMAGES  # noqa: E402
from tile_sets import TileSets  # noqa: E402

NADIR = sys.argv[1] if len(sys.argv) > 1 else str(HERE.parent.parent / "build/bin/nadir")
DEBIAN_PYTHON = "/usr/bin/python3"
SILENT, NOT_RUN = "no message", "not run"


def run(*command):
    try:
        return subprocess.run([str(c) for c in command], stdin=subprocess.DEVNULL, capture_output=True, text=True,
                              errors="replace", timeout=20)
    except subprocess.TimeoutExpired:
        return None


def verdict(result):
    if result is None:
        return "does not end (20 s)"
    return SILENT if result.returncode == 0 else "refuses"


def tool(name, *command):
    return verdict(run(name, *command)) if shutil.which(name) else NOT_RUN


def mbtiles(path, work):
    # By default it requires its own digest in the metadata and rejects files that it has not stamped.
    return tool("mbtiles", "validate", "--agg-hash", "off", path)


def pmtiles(path, work):
    if not shutil.which("pmtiles"):
        return NOT_RUN
    out = work / "converted.pmtiles"
    out.unlink(missing_ok=True)
    converted = run("pmtiles", "convert", path, out)
    if converted is None or converted.returncode != 0:
        return verdict(converted) + " to convert" if converted else verdict(converted)
    return verdict(run("pmtiles", "verify", out))


def rio_cogeo(path, work):
    if not shutil.which("rio"):
        return NOT_RUN
    result = run("rio", "cogeo", "validate", "--strict", path)
    if result and result.returncode == 0 and "NOT a valid" in result.stdout:
        return "refuses"
    return verdict(result)


def validate_cog(path, work):
    # Debian's own Python, because that is where gdal-bin brings GDAL's modules.
    module = "osgeo_utils.samples.validate_cloud_optimized_geotiff"
    if run(DEBIAN_PYTHON, "-c", f"import {module}").returncode != 0:
        return NOT_RUN
    return verdict(run(DEBIAN_PYTHON, "-m", module, "-q", "--full-check=yes", path))


def gdalinfo(path, work):
    result = run("gdalinfo", "-checksum", path)
    if result and result.returncode == 0 and "ERROR" in result.stderr:
        return "error, exit code 0"
    return verdict(result)


def integrity(path, work):
    result = run("sqlite3", f"file:{path}?mode=ro&immutable=1", "PRAGMA integrity_check")
    if result and result.returncode == 0 and result.stdout.strip() != "ok":
        return "refuses"
    return verdict(result)


def nadir(path, mission):
    result = run(NADIR, "cache", "validate", path, "--mission", mission, "--at", "2024-11-05", "--json")
    findings = json.loads(result.stdout)["findings"]
    codes = sorted({f["code"] for f in findings if f["severity"] != "note"})
    return ("refuses: " if result.returncode else "warns: " if codes else "accepts") + ", ".join(codes)


OTHERS = {"mbtiles": [mbtiles, pmtiles, integrity, gdalinfo], "cog": [rio_cogeo, validate_cog, gdalinfo]}


def table(title, container, rows, mission, work):
    others = OTHERS[container]
    print(f"\n{title}\n\n| | nadir cache validate | " + " | ".join(o.__name__.replace("_", " ") for o in others) + " |")
    print("|---" * (2 + len(others)) + "|")
    for name, path in rows:
        print(f"| {name} | {nadir(path, mission)} | " + " | ".join(o(path, work) for o in others) + " |", flush=True)


def made_by_others(sets, work):
    """The tile sets of PyPI's tools and GDAL's Python from the same raster, where they are installed."""
    recipes = [
        ("rio-mbtiles", "rio.mbtiles", [["rio", "mbtiles", sets.map, work / "rio.mbtiles", "--zoom-levels", "16..17",
                                         "--format", "JPEG"]]),
        ("gdal2tiles and mbutil", "gdal2tiles.mbtiles",
         [["gdal2tiles.py", "-q", "-z", "16-17", sets.map, work / "gdal2tiles"],
          ["mb-util", work / "gdal2tiles", work / "gdal2tiles.mbtiles", "--scheme=tms", "--image_format=png"]]),
        ("rio-cogeo", "rio-cogeo.tif", [["rio", "cogeo", "create", sets.map, work / "rio-cogeo.tif", "--web-optimized",
                                         "-p", "jpeg", "--blocksize", "256", "--add-mask"]]),
    ]
    for name, file, commands in recipes:
        if not all(shutil.which(command[0]) for command in commands):
            print(f"{name}: NOT RUN: tool missing")
        elif all((result := run(*command)) and result.returncode == 0 for command in commands):
            yield name, work / file
        else:
            print(f"{name}: NOT RUN: {result.stderr.strip()[-200:] if result else 'no end'}")


def made_by_nadir(sets, work):
    """A package of each container, built from the same raster; the validators must accept its tile set."""
    for name in ("root", "signer"):
        run(NADIR, "keys", "create", "--out", work / name)
    facts = ["--captured", "2024-10-01", "--gsd-m", "0.8", "--ce90-m", "4", "--provider", "test"]
    rows = {}
    for container, file in (("mbtiles", "base.mbtiles"), ("cog", "base.tif")):
        out = work / f"package-{container}"
        result = run(NADIR, "cache", "build", "--mission", sets.mission, "--imagery", sets.map, *facts, "--format",
                     container, "--key", work / "signer.key.pem", "--out", out)
        if result is None or result.returncode != 0:
            print(f"\nNOT RUN: nadir cache build --format {container}: {result.stderr.strip() if result else 'no end'}")
            continue
        rows[container] = [(f"package by Nadir, {container}", out / "imagery" / file)]
    return rows


def main():
    for name, how in (("mbtiles", "--version"), ("pmtiles", "version"), ("rio", "--version"), ("gdalinfo", "--version"),
                      ("sqlite3", "--version")):
        found = run(name, how).stdout.strip()[:40] if shutil.which(name) else "NOT RUN: tool missing"
        print(f"{name}: {found}")
    with tempfile.TemporaryDirectory(prefix="nadir-validators.") as folder:
        work = pathlib.Path(folder)
        sets = TileSets(work)
        made = {"mbtiles": [], "cog": []}
        for name, path in [*sets.intact().items(), *made_by_others(sets, work)]:
            made["cog" if path.suffix == ".tif" else "mbtiles"].append((name, path))
        for number, (name, container, make, _) in enumerate(DAMAGES):
            path = work / f"{number}.{'tif' if container == 'cog' else 'mbtiles'}"
            make(sets, path)
            made[container].append((name, path))
        for container, rows in made_by_nadir(sets, work).items():
            made[container] = rows + made[container]
        table("MBTiles", "mbtiles", made["mbtiles"], sets.mission, work)
        table("COG", "cog", made["cog"], sets.mission, work)


if __name__ == "__main__":
    main()
