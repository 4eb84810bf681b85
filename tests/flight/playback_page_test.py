#!/usr/bin/env python3
"""A recording on the page of nadird, in a real browser.

usage: playback_page_test.py NADIRD RECORD_CIRCLE [FOLDER_FOR_SCREENSHOTS]
Exit code 77: there is no chromium here.
"""
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest
import urllib.error
import urllib.request

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "api"))
from browser import Browser, find_axe, find_chromium  # noqa: E402

NADIRD, RECORD_CIRCLE = sys.argv[1:3]
SCREENSHOTS = pathlib.Path(sys.argv[3]) if len(sys.argv) > 3 else None
TEXT = "document.getElementById('{}').textContent"
MOMENT = "Number(document.getElementById('moment').value)"


class PlaybackPage(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.recording = pathlib.Path(cls.folder.name) / "record"
        subprocess.run([RECORD_CIRCLE, cls.recording], check=True)

    def setUp(self):
        self.nadird = subprocess.Popen([NADIRD, "--play", self.recording, "--listen", "127.0.0.1:0"], stderr=subprocess.PIPE, text=True)
        self.addCleanup(self.stop)
        self.url = re.search(r"http://\S+", self.nadird.stderr.readline())[0].rstrip("/")

    def stop(self):
        if self.nadird.poll() is None:
            self.nadird.terminate()
        self.assertEqual(0, self.nadird.wait(timeout=60))
        self.nadird.stderr.close()

    def browse(self, width=1366, height=768, mobile=False):
        browser = Browser(width, height, mobile)
        self.addCleanup(browser.close)
        browser.open(self.url)
        browser.wait_for(TEXT.format("recorded") + ".includes('UTC')")
        return browser

    def keep(self, browser, name):
        if SCREENSHOTS:
            browser.screenshot(SCREENSHOTS / f"{name}.png")

    def post(self, path, body):
        request = urllib.request.Request(self.url + path, json.dumps(body).encode(), {"Content-Type": "application/json"})
        with urllib.request.urlopen(request) as response:
            return json.load(response)

    def test_plays_pauses_and_jumps(self):
        browser = self.browse()
        self.assertEqual("of 2025-10-09 08:53:20 UTC", browser.evaluate(TEXT.format("recorded")))
        self.assertTrue(browser.evaluate("document.title").startswith("RECORDING"))
        browser.wait_for(MOMENT + " > 0")
        browser.press(" ")
        browser.wait_for(TEXT.format("play") + " === 'Play'")
        self.post("/v1/playback", {"playing": False, "at_s": 25})  # somebody else does
        browser.wait_for(TEXT.format("state") + " === 'normal'")
        browser.wait_for(TEXT.format("clock") + " === '08:53:45 UTC, 0:25 of 1:00'")
        browser.wait_for("document.querySelectorAll('#alarms li').length === 2")
        browser.wait_for(TEXT.format("package") + ".includes('none was flown')")
        self.assertFalse(browser.evaluate("document.body.classList.contains('stale')"))
        age = browser.evaluate(TEXT.format("anchor-age"))
        self.keep(browser, "playback")

        browser.press("ArrowRight")
        browser.wait_for(TEXT.format("state") + " === 'degraded'")
        browser.wait_for(TEXT.format("events") + ".includes('no frames from the camera')")
        self.keep(browser, "playback-blind")
        browser.press("ArrowLeft", "ArrowLeft")
        browser.wait_for(TEXT.format("clock") + ".includes('0:15 of')")
        browser.wait_for("document.getElementById('alarm-list').hidden")
        browser.wait_for("!" + TEXT.format("events") + ".includes('no frames from the camera')")

        browser.evaluate("document.getElementById('moment').value = 25, document.getElementById('moment').dispatchEvent(new Event('input'))")
        browser.wait_for("document.querySelectorAll('#alarms li').length === 2")
        browser.wait_for(TEXT.format("anchor-age") + f" === '{age}'")  # nothing grows older while it is paused
        browser.evaluate("document.getElementById('rate').value = 16, document.getElementById('rate').dispatchEvent(new Event('change'))")
        browser.evaluate("document.getElementById('play').click()")
        browser.wait_for(TEXT.format("clock") + ".includes('1:00 of 1:00')")
        browser.wait_for(TEXT.format("play") + " === 'Play'")
        self.assertEqual(16, self.state()["playback"]["speed"])
        self.assertEqual([], browser.complaints())

    def state(self):
        with urllib.request.urlopen(self.url + "/v1/state") as response:
            return json.load(response)

    def test_cannot_be_taken_for_a_flight(self):
        for path, status in (("/v1/health", 503), ("/v1/hint", 409)):
            with self.assertRaises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(self.url + path) if status == 503 else self.post(path, {"lat": 48, "lon": 11, "radius_m": 9})
            self.assertEqual(status, refused.exception.code)
            refused.exception.close()
        shown = subprocess.run([NADIRD, "--status", "--listen", self.url.removeprefix("http://")], capture_output=True, text=True)
        self.assertEqual(1, shown.returncode)
        self.assertIn("RECORDING of 2025-10-09T08:53:20Z", shown.stdout)

        self.post("/v1/playback", {"playing": False, "at_s": 25})
        axe = find_axe()
        for width, height, mobile in ((390, 844, True), (1366, 768, False)):
            browser = self.browse(width, height, mobile)
            browser.wait_for("document.querySelector('#map-view .aircraft path[fill]') !== null")
            self.assertEqual(width, browser.evaluate("document.documentElement.scrollWidth"), "it scrolls sideways")
            self.assertEqual(0, browser.evaluate("(scrollTo(0, 9999), document.getElementById('playback').getBoundingClientRect().top)"))
            if axe:
                self.assertEqual([], browser.barriers(axe))
            self.keep(browser, f"playback-{width}")


if __name__ == "__main__":
    if not find_chromium():
        print("SKIPPED: no chromium here; `apt-get install chromium-headless-shell` tests the page", file=sys.stderr)
        sys.exit(77)
    unittest.main(argv=[sys.argv[0]], verbosity=2)
