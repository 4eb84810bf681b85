#!/usr/bin/env python3
"""The pictures of docs/put-photos-on-the-map.md, docs/plan-a-mission.md, docs/fly-a-mission.md and docs/integrity.md, made in a real browser from the commands of these pages.

usage: pictures.py PROJECT_ROOT FOLDER_OF_PROGRAMS [OUT [PAGE]…]     OUT: docs/images by default; all pages by default. README.md, when named, has the
       pictures of the demo's own pages, and needs `./run demo` before

Needs chromium, and gdal_translate for JPEG.
"""
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

ROOT, PROGRAMS = map(pathlib.Path, sys.argv[1:3])
OUT = pathlib.Path(sys.argv[3]) if len(sys.argv) > 3 else ROOT / "docs" / "images"
sys.path.insert(0, str(ROOT / "tests" / "api"))
from browser import Browser, find_chromium  # noqa: E402

ONLY = sys.argv[4:]
ENVIRONMENT = {**os.environ, "PATH": f"{PROGRAMS.resolve()}:{os.environ['PATH']}"}
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


def with_desk(page, take):
    """Runs the commands of the page, and take(folder, address) while its desk is open."""
    blocks = re.findall(r"^```sh test\n(.*?)^```", page.read_text(), re.M | re.S)
    with tempfile.TemporaryDirectory(prefix="nadir-pictures.") as name:
        folder = pathlib.Path(name)
        # The desk of the page stays open until this program has closed the pipe.
        script = "".join(blocks) + 'echo "desk $url $id"\nread -r _ || true\n'
        running = subprocess.Popen(["bash", "-euo", "pipefail", "-c", script], cwd=folder, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                   env=ENVIRONMENT)
        found = next((line.split()[1:] for line in running.stdout if line.startswith("desk http")), None)
        if found is None:
            raise SystemExit(f"the commands of {page} end with {running.wait()}")
        take(folder, *found)
        running.stdin.close()
        running.wait()


def photos(folder, url, flight):
    report(folder / "result" / "report.html", "photos-report")
    report(folder / "wrong" / "report.html", "photos-no-fix")
    browser = Browser(WIDTH, HEIGHT)
    browser.open(f"{url}/#{flight}")
    browser.wait_for("!document.getElementById('flight').hidden")
    browser.wait_for("[...document.querySelectorAll('#flight img')].every((image) => image.naturalWidth > 0 || image.hidden)")
    keep(browser, "photos-desk")
    browser.close()


def mission(folder, url, number):
    browser = Browser(WIDTH, HEIGHT)
    browser.open(f"{url}/missions#{number}")
    browser.wait_for("document.querySelectorAll('#map .imagery-pane img[src]').length > 4 && document.getElementById('profile-text').textContent.includes('above ground')")
    browser.evaluate("document.getElementById('layer-prediction').click(); document.querySelector('[data-points=route] li:nth-child(3) .number').click()")
    time.sleep(2)  # tiles fade in
    keep(browser, "mission-draw")
    browser.evaluate("document.getElementById('layer-prediction').click(); document.querySelector('input[name=fact][value=matchability]').click(); document.getElementById('layers').scrollIntoView()")
    browser.wait_for("!document.getElementById('legend').hidden")
    time.sleep(2)
    keep(browser, "mission-prediction")
    browser.evaluate("document.getElementById('making').scrollIntoView(); document.querySelector('[data-step=sign] details').open = true")
    keep(browser, "mission-package")
    browser.close()


def with_flight(page):
    """The page's own flight, a minute long, while its camera is dark."""
    prepare = re.search(r"^```sh test\n(.*?)^```", page.read_text(), re.M | re.S).group(1)
    with tempfile.TemporaryDirectory(prefix="nadir-pictures.") as name:
        found = {"cwd": name, "text": True, "env": ENVIRONMENT}
        subprocess.run(["bash", "-euo", "pipefail", "-c", prepare], check=True, **found)
        flight = subprocess.Popen(["nadir", "simulate", "loop", "--world", "world", "--circumstance", "blackout", "--minutes", "1", "--port", "0"],
                                  stderr=subprocess.PIPE, **found)
        browser = Browser(WIDTH, HEIGHT)
        for line in flight.stderr:
            if address := re.search(r"nadird's page: (\S+)", line):
                browser.open(address.group(1))
            if "NO FRAMES" in line:
                break
        time.sleep(6)
        browser.wait_for("document.body.dataset.state === 'degraded'")
        keep(browser, "fly-blackout")
        complaints = browser.complaints()
        browser.close()
        flight.communicate()
        if complaints:
            raise SystemExit(f"the page's console: {complaints}")


LEVELS = """
nadir simulate world --seed 7 --size-km 2 --gsd-m 0.5 --out world --quiet
nadir keys create --out root
nadir keys create --out signer
nadir keys root --root-key root.key.pem --package-signer signer.pub.pem --expires 2035-01-01 --out root.json
nadir cache build --mission world/mission.yaml --imagery world/map.tif --dem world/dem.tif --key signer.key.pem --out package --quiet
nadir simulate flight --world world/ground.tif --dem world/dem.tif --mission world/mission.yaml --camera world/camera.yaml --seed 11 --noise real --out flown --quiet
ls flown/frames | sed -n 25,36p | while read -r frame; do  # the camera is dark
  gdal_translate -q -of JPEG -scale 0 255 0 0 "flown/frames/$frame" dark.jpg
  mv dark.jpg "flown/frames/$frame"
done
start=$(awk -F, 'NR == 2 { print $3 "," $2 }' flown/truth.csv)
nadir replay --frames flown/frames --telemetry flown/telemetry.csv --camera world/camera.yaml --start="$start" --truth flown/truth.csv \
  --package package --trust root.json --at "$(sed -n 's/^created: *//p' world/mission.yaml)" --out result
"""


def levels():
    """The chart of a flight whose camera is dark for a while."""
    with tempfile.TemporaryDirectory(prefix="nadir-pictures.") as name:
        subprocess.run(["bash", "-euo", "pipefail", "-c", LEVELS], check=True, cwd=name, env=ENVIRONMENT)
        browser = Browser(1100, 330)
        browser.open((pathlib.Path(name) / "result" / "report.html").as_uri())
        browser.wait_for("document.querySelectorAll('#strip button').length > 0")
        browser.evaluate("document.getElementById('chart-title').scrollIntoView()")
        keep(browser, "integrity-levels")
        browser.close()


def demo():
    """What `./run demo` left."""
    for page, name, height in (("report/report.html", "report", 1180), ("live.html", "live", 1280)):
        browser = Browser(1240, height)
        browser.open((ROOT / "demo" / page).resolve().as_uri())
        time.sleep(3)  # tiles fade in
        keep(browser, name)
        browser.close()


def main():
    if not find_chromium():
        raise SystemExit("NOT RUN: no chromium")
    for page, take in PAGES.items():
        if not ONLY or page in ONLY:
            with_desk(ROOT / "docs" / page, take)
    if not ONLY or "fly-a-mission.md" in ONLY:
        with_flight(ROOT / "docs" / "fly-a-mission.md")
    if not ONLY or "integrity.md" in ONLY:
        levels()
    if "README.md" in ONLY:
        demo()


PAGES = {"put-photos-on-the-map.md": photos, "plan-a-mission.md": mission}
main()
