#!/usr/bin/env python3
"""The pictures of docs/put-photos-on-the-map.md, made in a real browser from the commands of that page.

usage: pictures.py PROJECT_ROOT FOLDER_OF_PROGRAMS [OUT]     OUT: docs/images by default

Needs chromium, and gdal_translate for JPEG.
"""
import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT, PROGRAMS = map(pathlib.Path, sys.argv[1:3])
OUT = pathlib.Path(sys.argv[3]) if len(sys.argv) > 3 else ROOT / "docs" / "images"
sys.path.insert(0, str(ROOT / "tests" / "api"))
from browser import Browser, find_chromium  # noqa: E402

PAGE = ROOT / "docs" / "put-photos-on-the-map.md"
WIDTH, HEIGHT, QUALITY = 1280, 860, 72


def keep(browser, name):
    with tempfile.TemporaryDirectory() as folder:
        png = pathlib.Path(folder) / "shot.png"
        browser.screenshot(png)
        subprocess.run(["gdal_translate", "-q", "-of", "JPEG", "-b", "1", "-b", "2", "-b", "3", "-co", f"QUALITY={QUALITY}", png, OUT / f"{name}.jpg"], check=True)
    (OUT / f"{name}.jpg.aux.xml").unlink(missing_ok=True)


def report(path, name):
    browser = Browser(WIDTH, HEIGHT)
    browser.open(path.resolve().as_uri())
    browser.wait_for("document.querySelectorAll('#strip button').length > 0")
    keep(browser, name)
    browser.close()


def main():
    if not find_chromium():
        raise SystemExit("NOT RUN: no chromium")
    blocks = re.findall(r"^```sh test\n(.*?)^```", PAGE.read_text(), re.M | re.S)
    with tempfile.TemporaryDirectory(prefix="nadir-pictures.") as name:
        folder = pathlib.Path(name)
        # The desk of the page stays open until this program has closed the pipe.
        script = "".join(blocks) + 'echo "desk $url/#$id"\nread -r _ || true\n'
        page = subprocess.Popen(["bash", "-euo", "pipefail", "-c", script], cwd=folder, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                env={**os.environ, "PATH": f"{PROGRAMS.resolve()}:{os.environ['PATH']}"})
        address = next((line.split()[1] for line in page.stdout if line.startswith("desk http")), None)
        if address is None:
            raise SystemExit(f"the commands of {PAGE} end with {page.wait()}")
        report(folder / "result" / "report.html", "photos-report")
        report(folder / "wrong" / "report.html", "photos-no-fix")
        browser = Browser(WIDTH, HEIGHT)
        browser.open(address)
        browser.wait_for("!document.getElementById('flight').hidden")
        browser.wait_for("[...document.querySelectorAll('#flight img')].every((image) => image.naturalWidth > 0 || image.hidden)")
        keep(browser, "photos-desk")
        browser.close()
        page.stdin.close()
        page.wait()


main()
