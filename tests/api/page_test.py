#!/usr/bin/env python3
"""The web page in a real browser, against a real server that flies a script.

usage: page_test.py TEST_API_SERVER [FOLDER_FOR_SCREENSHOTS]
Exit code 77: there is no chromium here.
"""
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from browser import Browser, find_axe, find_chromium  # noqa: E402
from scripted_service import ScriptedService  # noqa: E402

SERVER = sys.argv[1]
SCREENSHOTS = pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else None
TEXT = "document.getElementById('{}').textContent"
IS = TEXT + " === '{}'"
# The map's tiles are there, and the aircraft on them.
MAP = "document.querySelectorAll('#map-view img.leaflet-tile-loaded[src]').length > 3 && document.querySelector('#map-view .aircraft path[fill]') !== null"


class Page(unittest.TestCase):
    sizes = {"phone": (390, 844, True), "laptop": (1366, 768, False), "desk": (1920, 1080, False)}

    def serve(self, *options):
        service = ScriptedService(SERVER, *options)
        self.addCleanup(service.stop)
        return service

    page = None

    def browse(self, url, size="laptop", beside=False):
        """The page before it, which would go on drawing, is closed unless they are wanted beside each other."""
        if self.page and not beside:
            self.page.close()
        self.page = Browser(*self.sizes[size])
        self.addCleanup(self.page.close)
        self.page.open(url)
        return self.page

    def keep(self, browser, name):
        if SCREENSHOTS:
            browser.screenshot(SCREENSHOTS / f"{name}.png")

    def test_shows_the_flight_live(self):
        service = self.serve()
        browser = self.browse(service.url)
        browser.wait_for(IS.format("state", "normal"))
        browser.wait_for(TEXT.format("sigma") + " === '2.8m'")
        self.assertEqual("18m", browser.evaluate(TEXT.format("hpl")))
        self.assertEqual("protection level", browser.evaluate(TEXT.format("hpl-limit")))
        self.assertIn("alert limit 100 m", browser.evaluate("document.getElementById('hpl-limit').title"))
        colour = "getComputedStyle(document.getElementById('hpl')).color"
        usable = browser.evaluate(colour)
        self.assertEqual("anchored to the map", browser.evaluate(TEXT.format("reason")))
        self.assertIn("signed", browser.evaluate(TEXT.format("link")))
        self.assertIn("spoofed", browser.evaluate(TEXT.format("gps")))
        self.assertIn("valley", browser.evaluate(TEXT.format("package")))
        self.assertIn("GPS judged spoofed", browser.evaluate(TEXT.format("events")))
        browser.wait_for(MAP)
        before = browser.evaluate(TEXT.format("coordinates"))
        browser.wait_for(TEXT.format("coordinates") + f" !== '{before}'")  # it moves without anybody's doing
        self.keep(browser, "normal")

        service.command("degraded")
        browser.wait_for(IS.format("state", "degraded"))
        browser.wait_for("document.querySelector('#events li').textContent.includes('camera sees cloud')")
        self.assertEqual("247m", browser.evaluate(TEXT.format("hpl")))
        self.assertIn("NOT USABLE", browser.evaluate(TEXT.format("hpl-limit")))
        self.assertNotEqual(usable, browser.evaluate(colour), "beyond the alert limit it is red")
        self.keep(browser, "degraded")
        service.command("no_fix")
        browser.wait_for(IS.format("state", "no fix"))
        browser.wait_for(IS.format("coordinates", "no position"))
        self.assertEqual("–", browser.evaluate(TEXT.format("sigma")))
        self.assertEqual("–", browser.evaluate(TEXT.format("hpl")))

        self.assertEqual([], browser.complaints())
        foreign = [url for url in browser.requested() if not url.startswith((service.url, "data:", "blob:", "about:"))]
        self.assertEqual([], foreign, "the page asks others")

    def test_stale_data_is_marked(self):
        service = self.serve()
        browser = self.browse(service.url)
        browser.wait_for(IS.format("state", "normal"))
        self.assertFalse(browser.evaluate("document.body.classList.contains('stale')"))
        service.command("stall")
        browser.wait_for("document.body.classList.contains('stale')")
        browser.wait_for("!document.getElementById('lost').hidden")
        browser.wait_for(IS.format("state", "stale"))
        self.keep(browser, "stale")
        service.command("go")
        browser.wait_for("!document.body.classList.contains('stale')")
        browser.wait_for(IS.format("state", "normal"))
        service.stop()
        browser.wait_for(TEXT.format("lost") + ".startsWith('No contact')")

    def test_ages_count_up_and_the_heading_stays_while_blind(self):
        service = self.serve()
        browser = self.browse(service.url)
        browser.wait_for(IS.format("state", "normal"))
        service.command("degraded")
        browser.wait_for(IS.format("state", "degraded"))
        browser.wait_for("Number.parseFloat(document.getElementById('anchor-age').textContent) > 16")
        browser.wait_for(TEXT.format("frames") + ".includes('NONE for 3 s')")
        self.assertRegex(browser.evaluate(TEXT.format("heading")), r"^\d\d\d°$")
        self.keep(browser, "blind")
        service.command("stall")  # no view comes any more: the ages go on
        browser.wait_for("document.body.classList.contains('stale')")
        before = float(browser.evaluate("Number.parseFloat(document.getElementById('anchor-age').textContent)"))
        browser.wait_for(f"Number.parseFloat(document.getElementById('anchor-age').textContent) > {before + 1}")

    def test_repeats_are_one_line_and_alarms_stay(self):
        service = self.serve()
        browser = self.browse(service.url)
        browser.wait_for("document.querySelectorAll('#alarms li').length === 1")
        service.command("corrupt")
        browser.wait_for("document.querySelectorAll('#alarms li').length === 2")
        browser.wait_for(TEXT.format("package") + ".includes('1 CORRUPT TILE')")
        service.command("flap")
        browser.wait_for(TEXT.format("events") + ".includes('× 5')")
        lines = browser.evaluate("[...document.querySelectorAll('#events li')].map((line) => line.textContent)")
        self.assertEqual(1, sum("no frames from the camera" in line for line in lines), lines)
        service.command("unsigned")
        browser.wait_for(TEXT.format("link") + ".includes('NOT SIGNED')")
        self.keep(browser, "alarms")
        service.command("chatter")
        browser.wait_for("document.querySelectorAll('#events li').length === 40")
        self.assertNotIn("CORRUPT", browser.evaluate(TEXT.format("events")).upper().replace("NOTE", ""))
        self.assertIn("artifact.hash", browser.evaluate(TEXT.format("alarms")))
        later = self.browse(service.url, beside=True)  # somebody who opens the page now
        later.wait_for("document.querySelectorAll('#alarms li').length === 2")
        self.assertEqual([], browser.complaints())

    def test_sounds_when_the_state_changes(self):
        service = self.serve()
        browser = self.browse(service.url)
        browser.wait_for(IS.format("state", "normal"))
        played = "document.getElementById('sound').dataset.played"
        service.command("degraded")
        browser.wait_for(IS.format("state", "degraded"))
        self.assertIsNone(browser.evaluate(played), "it is silent until somebody wants it")
        # What is given to the loudspeaker.
        browser.evaluate("window.heard = []; const start = OscillatorNode.prototype.start; "
                         "OscillatorNode.prototype.start = function (at) { heard.push(this.frequency.value); start.call(this, at); }")
        self.press_sound(browser)
        browser.wait_for("document.getElementById('sound').getAttribute('aria-pressed') === 'true'")
        self.assertEqual([523, 784], browser.evaluate("heard"), "a sample")
        for command, sound in (("relocalizing", "worse"), ("degraded", "better"),
                               ("corrupt", "alarm"),  # of the same state
                               ("no_fix", "alarm"),   # and not two things at once
                               ("stall", "alarm"), ("go", "better")):  # the display is stale
            with self.subTest(command):
                self.silence(browser)
                service.command(command)
                browser.wait_for(f"{played} === '{sound}'")
        self.silence(browser)
        service.command("corrupt")
        browser.wait_for(played + " === 'alarm'")
        self.assertEqual([988, 740, 988, 740, 988], browser.evaluate("heard"))
        self.silence(browser)
        self.press_sound(browser)
        service.command("degraded")
        browser.wait_for(IS.format("state", "degraded"))
        self.assertEqual([], browser.evaluate("heard"))
        self.assertEqual([], browser.complaints())

    def press_sound(self, browser):
        """By the mouse: browsers give no sound to scripts alone."""
        x, y = browser.evaluate("(() => { const { x, y, width, height } = document.getElementById('sound').getBoundingClientRect(); return [x + width / 2, y + height / 2]; })()")
        browser.mouse(("click", x, y))

    def silence(self, browser):
        """Until the tones are over; what was heard is forgotten."""
        browser.evaluate("new Promise((done) => setTimeout(done, 1200)).then(() => { window.heard = []; delete document.getElementById('sound').dataset.played; })")

    def test_fits_its_window(self):
        service = self.serve()
        for size, (width, _, _) in self.sizes.items():
            with self.subTest(size):
                browser = self.browse(service.url, size)
                browser.wait_for(IS.format("state", "normal"))
                browser.wait_for(MAP)
                self.assertEqual(width, browser.evaluate("document.documentElement.scrollWidth"), "it scrolls sideways")
                cut = browser.evaluate("[...document.querySelectorAll('main *')].filter((e) => e.scrollWidth > e.clientWidth + 1 && e.clientWidth > 0).map((e) => e.id || e.tagName)")
                self.assertEqual([], cut, "text that does not fit")
                self.keep(browser, size)

    def test_follows_the_aircraft_until_somebody_moves_the_map(self):
        service = self.serve()
        browser = self.browse(service.url)
        browser.wait_for(MAP)
        middle = """(() => {
          const map = document.getElementById('map-view').getBoundingClientRect(), aircraft = document.querySelector('.aircraft').getBoundingClientRect();
          return Math.hypot(aircraft.x + aircraft.width / 2 - map.x - map.width / 2, aircraft.y + aircraft.height / 2 - map.y - map.height / 2);
        })()"""
        self.assertLess(browser.evaluate(middle), 3)
        browser.evaluate("document.getElementById('map-view').dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowLeft', bubbles: true }))")
        self.assertEqual("false", browser.evaluate("document.getElementById('follow').getAttribute('aria-pressed')"))
        browser.evaluate("document.getElementById('follow').click()")
        self.assertLess(browser.evaluate(middle), 3)

    def test_has_no_serious_barriers(self):
        axe = find_axe()
        if axe is None:
            self.skipTest("this Python has no axe-playwright-python; see .ci/python-requirements.txt")
        service = self.serve()
        for size in self.sizes:
            browser = self.browse(service.url, size)
            browser.wait_for(MAP)
            with self.subTest(size):
                self.assertEqual([], browser.barriers(axe))
        for state in ("degraded", "no_fix"):
            service.command(state)
            browser.wait_for(IS.format("state", state.replace("_", " ")))
            with self.subTest(state):
                self.assertEqual([], browser.barriers(axe))
        self.assertEqual([], browser.complaints())

    def test_asks_for_the_token(self):
        with tempfile.TemporaryDirectory() as folder:
            token = pathlib.Path(folder) / "token"
            token.touch(0o600)
            token.write_text("a-secret-of-the-crew\n")
            service = self.serve("--token-file", token)
            browser = self.browse(service.url)
            browser.wait_for("document.getElementById('ask').open")
            self.keep(browser, "token")
            browser.evaluate("document.getElementById('token').value = 'wrong', document.getElementById('give').click()")
            browser.wait_for("document.getElementById('ask').open")
            browser.evaluate("document.getElementById('token').value = 'a-secret-of-the-crew', document.getElementById('give').click()")
            browser.wait_for(IS.format("state", "normal"))
            browser.wait_for(MAP)


if __name__ == "__main__":
    if not find_chromium():
        print("SKIPPED: no chromium here; `apt-get install chromium-headless-shell` tests the page", file=sys.stderr)
        sys.exit(77)
    unittest.main(argv=[sys.argv[0]], verbosity=2)
