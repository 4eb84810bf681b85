#!/usr/bin/env python3
"""The desk's page in a real browser, against the real program over a simulated map.

usage: desk_page_test.py NADIR [FOLDER_FOR_SCREENSHOTS]
Exit code 77: there is no chromium here.
"""
import base64
import json
import pathlib
import sys
import unittest

SCREENSHOTS = pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else None
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from desk_support import FRAMES, Desk, make_world  # noqa: E402
from browser import Browser, find_chromium  # noqa: E402
import support  # noqa: E402

TEXT = "document.getElementById('{}').textContent"
SHOWN = "document.getElementById('{}').naturalWidth > 0"


class DeskPage(support.EndToEnd):
    sizes = {"phone": (390, 844, True), "laptop": (1280, 800, False), "desk": (1920, 1080, False)}

    def setUp(self):
        super().setUp()
        self.desk = Desk(self.folder / "desk", support.made_once("desk world", make_world)).start()
        self.addCleanup(self.desk.stop)

    def browse(self, address="", size="laptop"):
        browser = Browser(*self.sizes[size])
        self.addCleanup(browser.close)
        browser.open(self.desk.url + "/" + address)
        return browser

    def keep(self, browser, name):
        if SCREENSHOTS:
            browser.screenshot(SCREENSHOTS / f"{name}.png")

    def flown(self, frames=FRAMES, complete=False):
        flight = self.desk.create(name="Survey of the valley", package="valley")
        self.desk.send(flight, self.desk.frames()[:frames])
        self.desk.settled(flight)
        if complete:
            self.desk.json("POST", flight + "/complete", expect=202)
            self.desk.settled(flight)
        return flight, "#" + flight.rsplit("/", 1)[1]

    @staticmethod
    def choose(browser, field, files):
        """Puts files into a file input, as a person's choice does."""
        parts = [{"name": path.name, "data": base64.b64encode(path.read_bytes()).decode()} for path in files]
        browser.evaluate(f"""(() => {{
          const chosen = new DataTransfer();
          for (const {{ name, data }} of {json.dumps(parts)})
            chosen.items.add(new File([Uint8Array.from(atob(data), (c) => c.charCodeAt(0))], name));
          document.getElementById('{field}').files = chosen.files;
        }})()""")

    @staticmethod
    def key(browser, key, target="document.body"):
        browser.evaluate(f"{target}.dispatchEvent(new KeyboardEvent('keydown', {{ key: '{key}', bubbles: true, cancelable: true }}))")

    def check_quiet(self, browser):
        """No error, but for tiles beyond the edge of the map; nothing asked of others."""
        self.assertEqual([], [text for text in browser.complaints() if "/tiles/" not in text])
        foreign = [url for url in browser.requested() if not url.startswith((self.desk.url, "data:", "blob:", "about:"))]
        self.assertEqual([], foreign, "the page asks others")

    def test_from_pictures_to_a_track_with_a_fix(self):
        browser = self.browse()
        browser.wait_for(TEXT.format("packages") + ".includes('valley')")
        self.keep(browser, "empty")
        browser.evaluate("document.getElementById('new').click()")
        browser.evaluate("document.getElementById('create-name').value = 'Survey <b>of</b> the valley'")
        self.choose(browser, "create-camera", [self.desk.made / "flight" / "camera.yaml"])
        self.keep(browser, "create")
        browser.evaluate("document.querySelector('#create-form [type=submit]').click()")
        browser.wait_for("!document.getElementById('flight').hidden")
        self.assertEqual("Survey <b>of</b> the valley", browser.evaluate(TEXT.format("name")))

        browser.evaluate("document.getElementById('add').click()")
        self.choose(browser, "picture-files", self.desk.frames()[:8])
        self.choose(browser, "telemetry-file", [self.desk.made / "flight" / "telemetry.csv"])
        browser.evaluate("document.querySelector('#pictures-form [type=submit]').click()")
        browser.wait_for(TEXT.format("upload") + " === '8 accepted, 0 there already, 0 refused'")
        browser.wait_for(TEXT.format("counts") + ".startsWith('8 of 8 pictures')")  # live: nobody has reloaded it
        browser.wait_for(TEXT.format("frame-heading") + " === 'Frame 7'")
        browser.wait_for(TEXT.format("events") + ".includes('anchored to the map')")
        for image in ("image-picture", "image-seen", "image-map"):
            browser.wait_for(SHOWN.format(image))
        browser.wait_for(TEXT.format("verdict") + ".includes('patches agree')")
        browser.wait_for("document.querySelectorAll('#map img').length > 0")
        self.keep(browser, "live")

        # A fix by a click on the map, for the frame before the last.
        self.key(browser, "p")
        browser.wait_for(TEXT.format("frame-heading") + " === 'Frame 6'")
        self.key(browser, "f")
        browser.wait_for("!document.getElementById('asking').hidden")
        self.keep(browser, "asking")
        browser.evaluate("""(() => {
          const map = document.getElementById('map'), box = map.getBoundingClientRect();
          for (const type of ['mousedown', 'mouseup', 'click'])
            map.querySelector('.leaflet-map-pane').dispatchEvent(new MouseEvent(type, { clientX: box.left + box.width / 2, clientY: box.top + 60, bubbles: true, cancelable: true }));
        })()""")
        browser.wait_for("document.getElementById('fix-lat').value !== ''")
        browser.evaluate("document.querySelector('#fix [type=submit]').click()")
        browser.wait_for(TEXT.format("fix-answer") + ".startsWith('stored: applied before frame 8')")
        browser.wait_for(TEXT.format("events") + ".includes('fix by operator')")

        # Another one by keyboard alone: the middle of the map.
        self.key(browser, "f")
        browser.evaluate("document.getElementById('fix-lat').value = ''")
        self.key(browser, "Enter", "document.getElementById('map')")
        browser.wait_for("document.getElementById('fix-lat').value !== ''")
        self.key(browser, "f")
        self.key(browser, "Escape")
        self.assertTrue(browser.evaluate("document.getElementById('asking').hidden"))

        browser.evaluate("document.getElementById('complete').click()")
        browser.wait_for(TEXT.format("state") + " === 'completed'")
        browser.wait_for("document.getElementById('kind-refined').getAttribute('aria-pressed') === 'true'")
        self.check_quiet(browser)

    def test_a_break_is_marked_and_made_good(self):
        flight, address = self.flown(frames=4)
        browser = self.browse(address)
        browser.wait_for(TEXT.format("frame-heading") + " === 'Frame 3'")
        browser.wait_for(TEXT.format("contact") + " === 'live'")
        port = self.desk.port
        self.desk.kill()
        browser.wait_for("document.body.classList.contains('stale')")
        self.assertIn("No contact with the desk", browser.evaluate(TEXT.format("lost")))
        self.keep(browser, "stale")
        self.desk.start(f"127.0.0.1:{port}")
        self.desk.send(flight, self.desk.frames()[4:7])
        browser.wait_for("!document.body.classList.contains('stale')")
        browser.wait_for(TEXT.format("frame-heading") + " === 'Frame 6'")
        self.assertEqual(7, browser.evaluate("document.getElementById('frame').max * 1 + 1"))

    def test_fits_its_window(self):
        _, address = self.flown(complete=True)
        for size, (width, _, _) in self.sizes.items():
            with self.subTest(size):
                browser = self.browse(address, size)
                browser.wait_for(SHOWN.format("image-map"))
                browser.wait_for("document.querySelectorAll('#map img[src]').length > 0")
                self.assertEqual(width, browser.evaluate("document.documentElement.scrollWidth"), "it scrolls sideways")
                cut = browser.evaluate("[...document.querySelectorAll('main *')].filter((e) => e.scrollWidth > e.clientWidth + 1 && e.clientWidth > 0).map((e) => e.id || e.tagName)")
                self.assertEqual([], cut, "text that does not fit")
                unnamed = browser.evaluate("[...document.querySelectorAll('button, input, select')].filter((e) => !(e.textContent.trim() || e.getAttribute('aria-label') || e.getAttribute('aria-labelledby') || e.labels?.length)).map((e) => e.id)")
                self.assertEqual([], unnamed, "controls without a name")
                self.keep(browser, size)
                self.check_quiet(browser)


if __name__ == "__main__":
    if not find_chromium():
        print("SKIPPED: no chromium here; `apt-get install chromium` tests the page", file=sys.stderr)
        sys.exit(77)
    unittest.main(argv=[sys.argv[0]], verbosity=2)
