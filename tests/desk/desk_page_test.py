#!/usr/bin/env python3
"""The desk's page in a real browser, against the real program over a simulated map.

usage: desk_page_test.py NADIR [FOLDER_FOR_SCREENSHOTS]
Exit code 77: there is no chromium here.
"""
import base64
import csv
import json
import pathlib
import shutil
import signal
import sqlite3
import sys
import time
import unittest

SCREENSHOTS = pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else None
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from desk_support import FRAMES, Desk, make_world  # noqa: E402
from browser import Browser, find_axe, find_chromium  # noqa: E402
import support  # noqa: E402

FEET = 1 / 0.3048  # heights by so much too high are soon found out; other factors take a minute
TEXT = "document.getElementById('{}').textContent"
SHOWN = "document.getElementById('{}').naturalWidth > 0"


class DeskPage(support.EndToEnd):
    sizes = {"phone": (390, 844, True), "laptop": (1366, 768, False), "desk": (1920, 1080, False)}

    def setUp(self):
        super().setUp()
        self.desk = Desk(self.folder / "desk", support.made_once("desk world", make_world)).start()
        self.addCleanup(self.desk.stop)

    page = None

    def browse(self, address="", size="laptop"):
        """The page before it, which would go on drawing, is closed."""
        if self.page:
            self.page.close()
        self.page = Browser(*self.sizes[size])
        self.addCleanup(self.page.close)
        self.page.open(self.desk.url + "/" + address)
        return self.page

    def keep(self, browser, name):
        if SCREENSHOTS:
            browser.screenshot(SCREENSHOTS / f"{name}.png")

    def flown(self, frames=6, complete=False):
        """Starts the desk over a flight that has been flown there: (its path, its fragment of the page's address). Flown once for all tests."""
        def fly(folder):
            desk = Desk(folder, self.desk.made).start()
            flight = desk.create(name="Survey of the valley", package="valley")
            desk.send(flight, desk.frames()[:frames])
            desk.settled(flight)
            if complete:
                desk.json("POST", flight + "/complete", expect=202)
                desk.settled(flight)
            self.assertEqual(0, desk.stop())
        self.desk.stop()
        shutil.copytree(support.made_once(f"{frames} frames flown, completed: {complete}", fly), self.desk.root, dirs_exist_ok=True)
        self.desk.start()
        [flight] = self.desk.json("GET", "/v1/flights", expect=200)["flights"]
        return "/v1/flights/" + flight["id"], "#" + flight["id"]

    def test_it_says_why_nothing_matches(self):
        lines = [line.split("#")[0].split(":") for line in (self.desk.made / "flight" / "camera.yaml").read_text().splitlines()]
        camera = "".join(":".join(line if line[0] not in ("fx", "fy") else [line[0], f" {2 * float(line[1])}"]) + "\n" for line in lines)
        first = next(csv.DictReader((self.desk.made / "flight" / "truth.csv").read_text().splitlines()))
        flight = self.desk.create(name="Wrong lens", package="valley", camera=camera, start={"lon": float(first["lon_deg"]), "lat": float(first["lat_deg"])})
        self.desk.send(flight, self.desk.frames()[:6])
        self.desk.settled(flight)
        browser = self.browse("#" + flight.rsplit("/", 1)[1])
        browser.wait_for(TEXT.format("reason") + ".includes('focal length twice the true one')")
        self.assertFalse(browser.evaluate("document.getElementById('reason').hidden"))
        self.keep(browser, "no-fix")
        self.check_quiet(browser)

    def test_a_placement_is_taken_back(self):
        first = next(csv.DictReader((self.desk.made / "flight" / "truth.csv").read_text().splitlines()))
        start = {"lon": float(first["lon_deg"]), "lat": float(first["lat_deg"]) + 0.05}  # 5.6 km off
        flight = self.desk.create(name="Wrong start", package="valley", start=start)
        browser = self.browse("#" + flight.rsplit("/", 1)[1])
        browser.wait_for("!document.getElementById('flight').hidden")
        self.desk.send(flight, self.desk.frames())
        self.desk.settled(flight)
        browser.wait_for(TEXT.format("events") + ".includes('nothing matches: ') && " + TEXT.format("events") + ".includes('is the start wrong?')")
        browser.wait_for(TEXT.format("events") + ".includes('placed as a whole')")
        take_back = "document.querySelector('[data-take-back=\"0\"]')"
        browser.wait_for(f"{take_back} !== null")
        browser.wait_for("document.querySelectorAll('#map img').length > 0")  # where it is now, and no longer lost
        browser.wait_for("document.getElementById('help').hidden")
        # What was wrong no longer holds, and the frame is compared with the map where it is now.
        browser.wait_for("document.getElementById('reason').hidden")
        browser.wait_for(TEXT.format("events") + ".includes('pictures match the map now')")
        browser.wait_for(TEXT.format("verdict") + ".startsWith('accepted, ') && " + TEXT.format("verdict") + ".endsWith('where its segment was placed')")
        browser.wait_for(SHOWN.format("image-map"))
        self.keep(browser, "placed")
        browser.evaluate(f"{take_back}.focus()")
        self.assertEqual("Take the placement of segment 0 back", browser.evaluate("document.activeElement.getAttribute('aria-label')"))
        browser.evaluate("document.activeElement.click()")
        browser.wait_for(f"{take_back} === null")
        browser.wait_for(TEXT.format("events") + ".includes('segment 0 floats again')")
        browser.wait_for(TEXT.format("segments") + ".includes('floating')")
        browser.wait_for("!document.getElementById('reason').hidden && " + TEXT.format("reason") + ".includes('is the start wrong?')")
        browser.wait_for(TEXT.format("verdict") + " === 'off the map'")  # as in flight: nothing else is known of it
        self.keep(browser, "taken-back")
        self.desk.settled(flight)
        self.assertEqual("floating", self.desk.json("GET", flight + "/segments", expect=200)["segments"][0]["state"])
        self.check_quiet(browser)

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

    @staticmethod
    def click(browser, target, across, down):
        """On a Leaflet map, at these shares of its width and height."""
        browser.evaluate(f"""(() => {{
          const map = document.getElementById('{target}'), box = map.getBoundingClientRect();
          for (const type of ['mousedown', 'mouseup', 'click'])
            map.querySelector('.leaflet-map-pane').dispatchEvent(new MouseEvent(type, {{
              clientX: box.left + box.width * {across}, clientY: box.top + box.height * {down}, bubbles: true, cancelable: true }}));
        }})()""")

    def fixes(self, flight):
        return self.desk.json("GET", flight + "/fixes", expect=200)["fixes"]

    def check_quiet(self, browser):
        """No error; nothing asked of others."""
        self.assertEqual([], browser.complaints())
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

        # A place by a click on the map, for the frame before the last.
        self.key(browser, "p")
        browser.wait_for(TEXT.format("frame-heading") + " === 'Frame 6'")
        self.key(browser, "g")
        browser.wait_for("!document.getElementById('asking').hidden")
        self.click(browser, "map", 0.5, 0.2)
        browser.wait_for("document.getElementById('fix-lat').value !== ''")
        browser.evaluate("document.querySelector('#fix [type=submit]').click()")
        browser.wait_for(TEXT.format("fix-answer") + ".startsWith('stored: applied before frame 8')")
        browser.wait_for(TEXT.format("events") + ".includes('fix by operator')")

        # Another one by keyboard alone: the middle of the map.
        self.key(browser, "g")
        self.assertEqual("", browser.evaluate("document.getElementById('fix-lat').value"))
        self.key(browser, "Enter", "document.getElementById('map')")
        browser.wait_for("document.getElementById('fix-lat').value !== ''")
        self.key(browser, "g")
        self.key(browser, "Escape")
        self.assertTrue(browser.evaluate("document.getElementById('asking').hidden"))

        browser.evaluate("document.getElementById('complete').click()")
        browser.wait_for(TEXT.format("state") + " === 'completed'")
        browser.wait_for("document.getElementById('kind-adjusted').getAttribute('aria-pressed') === 'true'")
        self.check_quiet(browser)

    def test_photos_become_a_flight_when_what_they_do_not_say_is_stated(self):
        browser = self.browse()
        browser.wait_for(TEXT.format("packages") + ".includes('valley')")
        browser.evaluate("document.getElementById('photos').click()")
        photos = self.desk.frames()[:5]
        self.choose(browser, "import-files", [*photos, self.desk.made / "flight" / "telemetry.csv"])
        browser.evaluate("document.getElementById('import-files').dispatchEvent(new Event('change'))")
        browser.wait_for(TEXT.format("import-chosen") + " === '5 photos, 1 other file left out'")
        browser.evaluate("document.getElementById('import-name').value = 'From a card'")
        browser.evaluate("document.getElementById('import-send').click()")
        browser.wait_for("document.querySelectorAll('#import-missing li').length >= 2")  # times, focal length
        missing = browser.evaluate(TEXT.format("import-missing"))
        self.assertIn("interval_s", missing)
        self.assertIn("focal_px", missing)
        self.assertTrue(browser.evaluate("document.getElementById('import-facts').open"))
        self.keep(browser, "import")

        self.choose(browser, "import-camera", [self.desk.made / "flight" / "camera.yaml"])
        for field, value in {"import-interval": "2", "import-agl": "120"}.items():
            browser.evaluate(f"document.getElementById('{field}').value = '{value}'")
        browser.evaluate("document.getElementById('import-send').click()")
        browser.wait_for(TEXT.format("name") + " === 'From a card'")
        browser.wait_for(TEXT.format("counts") + ".startsWith('5 of 5 pictures')")
        browser.wait_for(TEXT.format("refusals") + ".includes('a heading: none')")
        self.assertEqual([], self.desk.json("GET", "/v1/imports", expect=200)["imports"])
        self.keep(browser, "imported")

        # Given up: the files go.
        browser.evaluate("document.getElementById('home').click()")
        browser.wait_for("!document.getElementById('list').hidden")
        browser.evaluate("document.getElementById('photos').click()")
        browser.evaluate("document.getElementById('import-name').value = 'Given up'")
        self.choose(browser, "import-files", photos)
        browser.evaluate("document.getElementById('import-files').dispatchEvent(new Event('change'))")
        browser.evaluate("document.getElementById('import-send').click()")
        browser.wait_for("document.querySelectorAll('#import-missing li').length >= 2")
        self.assertEqual(5, self.desk.json("GET", "/v1/imports", expect=200)["imports"][0]["photos"])
        browser.evaluate("document.getElementById('import-cancel').click()")
        browser.wait_for("!document.getElementById('import').open")
        for _ in range(100):
            if not self.desk.json("GET", "/v1/imports", expect=200)["imports"]:
                break
            time.sleep(0.05)
        else:
            self.fail("the import is still there")
        # The browser itself notes an answer of 422.
        self.assertEqual([], [text for text in browser.complaints() if "status of 422" not in text])

    def test_the_same_point_in_picture_and_map_is_a_fix(self):
        flight, address = self.flown()
        browser = self.browse(address)
        browser.wait_for(TEXT.format("frame-heading") + " === 'Frame 5'")
        self.key(browser, "f")
        browser.wait_for("document.querySelector('#picture-map .leaflet-image-layer')?.naturalWidth > 0")
        browser.wait_for(TEXT.format("asking") + ".startsWith('Click a point in the picture')")
        self.keep(browser, "pair-picture")
        self.click(browser, "picture-map", 0.5, 0.5)
        browser.wait_for(TEXT.format("asking") + ".startsWith('Now click the same point')")
        self.click(browser, "map", 0.5, 0.5)
        browser.wait_for("document.getElementById('fix-lat').value !== ''")
        self.keep(browser, "pair")
        browser.evaluate("document.getElementById('give-fix').click()")
        browser.wait_for(TEXT.format("fixes") + ".includes('Fix 1: pixel')")
        fix = self.fixes(flight)[0]
        camera = self.desk.json("GET", flight, expect=200)["camera"]
        self.assertEqual((5, 5), (fix["frame"], fix["sigma_m"]))
        self.assertAlmostEqual(camera["width"] / 2, fix["pixel"]["x"], delta=5, msg="the middle of the picture was clicked")
        self.assertAlmostEqual(camera["height"] / 2, fix["pixel"]["y"], delta=5)

        # Undone and done again by key: the desk has a withdrawn fix and another one.
        self.key(browser, "z")
        browser.wait_for(TEXT.format("fixes") + ".includes('withdrawn')")
        self.assertIsNotNone(self.fixes(flight)[0]["withdrawn"])
        self.key(browser, "y")
        browser.wait_for(TEXT.format("fixes") + ".includes('Fix 2: pixel')")
        self.assertEqual(fix["pixel"], self.fixes(flight)[1]["pixel"])
        browser.evaluate("document.querySelector('#fixes button').click()")
        browser.wait_for("document.querySelectorAll('#fixes .withdrawn').length === 2")

        # By keyboard alone.
        self.key(browser, "f")
        self.key(browser, "Enter", "document.getElementById('picture-map')")
        browser.wait_for(TEXT.format("asking") + ".startsWith('Now click the same point')")
        self.key(browser, "Enter", "document.getElementById('map')")
        browser.wait_for("document.activeElement.id === 'give-fix'")
        self.key(browser, "Escape")
        self.assertEqual("", browser.evaluate(TEXT.format("fix-pixel")))
        self.check_quiet(browser)

    def test_the_picture_is_dragged_onto_the_map(self):
        flight, address = self.flown()
        browser = self.browse(address)
        browser.wait_for(TEXT.format("frame-heading") + " === 'Frame 5'")
        self.key(browser, "d")
        browser.wait_for("document.querySelector('img.laid-picture')?.style.transform.startsWith('matrix3d')")
        browser.wait_for("document.activeElement.classList.contains('laid-picture')")
        self.keep(browser, "drag")
        # Where it lies, its corners are the footprint's: as wide on the map as on the ground.
        shown = browser.evaluate("(() => { const box = document.querySelector('img.laid-picture').getBoundingClientRect(); return [box.width, box.height]; })()")
        self.assertTrue(all(20 < side < 3000 for side in shown), shown)
        before = browser.evaluate("Number(document.getElementById('fix-lat').value)")
        for _ in range(5):
            self.key(browser, "ArrowUp", "document.activeElement")
        moved = browser.evaluate("Number(document.getElementById('fix-lat').value)")
        self.assertGreater(moved, before, "up is north")
        browser.evaluate("""(() => {
          const image = document.querySelector('img.laid-picture'), box = image.getBoundingClientRect();
          image.setPointerCapture = () => {};
          for (const [type, dx] of [['pointerdown', 0], ['pointermove', 40], ['pointerup', 40]])
            image.dispatchEvent(new PointerEvent(type, { pointerId: 1, clientX: box.left + 50 + dx, clientY: box.top + 50, bubbles: true }));
        })()""")
        self.assertAlmostEqual(moved, browser.evaluate("Number(document.getElementById('fix-lat').value)"), delta=1e-6, msg="to the east")
        self.key(browser, "Enter", "document.activeElement")
        self.assertEqual("give-fix", browser.evaluate("document.activeElement.id"))
        browser.evaluate("document.getElementById('give-fix').click()")
        browser.wait_for(TEXT.format("fixes") + ".includes('Fix 1: pixel')")
        self.assertTrue(browser.evaluate("document.querySelector('img.laid-picture') === null"))
        self.assertAlmostEqual(moved, self.fixes(flight)[0]["lat"], delta=1e-6)
        self.check_quiet(browser)

    def test_objects_are_marked_named_and_saved(self):
        flight, address = self.flown()
        browser = self.browse(address)
        browser.wait_for(TEXT.format("frame-heading") + " === 'Frame 5'")
        self.key(browser, "o")
        browser.wait_for("document.querySelector('#picture-map .leaflet-image-layer')?.naturalWidth > 0")
        self.click(browser, "picture-map", 0.45, 0.55)
        browser.wait_for("document.querySelector('#objects input') !== null")
        browser.wait_for("document.querySelector('#map .object-label')?.textContent === 'object 1'")
        browser.evaluate("(() => { const name = document.querySelector('#objects input'); name.value = 'the <b>well</b>'; name.dispatchEvent(new Event('change')); })()")
        browser.wait_for("document.querySelector('#map .object-label')?.textContent === 'the <b>well</b>'")
        document = self.desk.json("GET", flight + "/objects", expect=200)["objects"][0]
        self.assertEqual(1, len(document["sightings"]))
        self.assertIsNotNone(document["place"], document["reason"])
        # In another picture, by keyboard.
        browser.evaluate("document.body.focus()")
        self.key(browser, "p")
        browser.wait_for(TEXT.format("picture-frame") + " === 'Frame 4'")
        browser.evaluate("document.querySelector('#objects [data-sighting]').click()")
        self.key(browser, "Enter", "document.getElementById('picture-map')")
        browser.wait_for(TEXT.format("objects") + ".includes('2 sightings')")
        self.keep(browser, "objects")
        self.key(browser, "z")
        browser.wait_for(TEXT.format("objects") + ".includes('1 sighting')")
        browser.evaluate("[...document.querySelectorAll('#objects button')].at(-1).click()")
        browser.wait_for("document.querySelector('#objects li') === null")
        self.key(browser, "z")
        browser.wait_for("document.querySelector('#objects input')?.value === 'the <b>well</b>'")
        self.check_quiet(browser)

    def test_before_and_after_are_compared(self):
        _, address = self.flown(FRAMES, complete=True)
        browser = self.browse(address)
        browser.wait_for("document.getElementById('kind-adjusted').getAttribute('aria-pressed') === 'true'")
        self.key(browser, "c")
        browser.wait_for(TEXT.format("difference") + ".startsWith('Dashed: as it came. Frames differ by')")
        self.keep(browser, "compare")
        browser.evaluate("document.getElementById('kind-online').click()")
        browser.wait_for(TEXT.format("difference") + ".startsWith('Dashed: adjusted')")
        self.check_quiet(browser)

    def test_candidates_are_shown_beside_the_picture(self):
        flight, address = self.flown()
        place = self.desk.json("GET", flight + "/estimates?first=5", expect=200)["estimates"][0]["position"]
        self.desk.stop()
        candidates = [{"lat_deg": place["lat"] + i * 2e-4, "lon_deg": place["lon"], "heading_deg": 90 * i, "scale": 1, "likeness": 0.9 - 0.15 * i} for i in range(6)]
        body = {"segment": 0, "failed_looks": 3, "verdict": "few_inliers", "candidates": candidates}
        with sqlite3.connect(self.desk.root / "flights" / address[1:] / "flight.sqlite") as database:
            database.execute("INSERT INTO event (time_ms, kind, frame, body) VALUES (1, 'user_input_needed', 5, ?)", [json.dumps(body)])
        database.close()
        self.desk.start()
        browser = self.browse(address)
        browser.wait_for("!document.getElementById('candidates').hidden")
        browser.wait_for(SHOWN.format("candidates-picture"))
        self.assertEqual(5, browser.evaluate("document.querySelectorAll('#candidate-list li').length"), "at most five")
        self.assertEqual([90, 75, 60, 45, 30], browser.evaluate("[...document.querySelectorAll('#candidate-list meter')].map((meter) => meter.value)"))
        browser.wait_for("[...document.querySelectorAll('#candidate-list canvas')].every((c) => c.getContext('2d').getImageData(110, 82, 1, 1).data[3] === 255)")
        self.keep(browser, "candidates")
        browser.evaluate("document.querySelectorAll('#candidate-list button')[1].click()")
        browser.wait_for("document.getElementById('candidates').hidden")
        browser.wait_for(TEXT.format("fixes") + ".includes('Fix 1: aircraft at frame 5 within 50 m')")
        self.assertAlmostEqual(candidates[1]["lat_deg"], self.fixes(flight)[0]["lat"])
        self.check_quiet(browser)

    def test_a_flight_without_a_place_is_shown_quietly(self):
        flight = self.desk.create(name="Elsewhere", package="valley")
        header, *rows = self.desk.telemetry().splitlines()
        column = header.split(",").index("agl_m")
        wrong = [",".join(str(float(value) * FEET) if i == column else value for i, value in enumerate(row.split(","))) for row in rows]
        self.desk.send(flight, self.desk.frames()[:3], "\n".join([header, *wrong]) + "\n")
        self.desk.settled(flight)
        estimates = self.desk.json("GET", flight + "/estimates", expect=200)["estimates"]
        self.assertEqual([None] * 3, [estimate["position"] for estimate in estimates])
        for size in self.sizes:
            browser = self.browse("#" + flight.rsplit("/", 1)[1], size)
            browser.wait_for(TEXT.format("position") + " === 'not known'")
            browser.wait_for("!document.getElementById('help').hidden")
            self.key(browser, "d")
            browser.wait_for("document.querySelector('img.laid-picture')?.style.transform.startsWith('matrix3d')")
            self.key(browser, "c")
            self.key(browser, "w")
            self.keep(browser, "lost-" + size)
            self.check_quiet(browser)

    def test_a_break_is_marked_and_made_good(self):
        flight, address = self.flown()
        browser = self.browse(address)
        browser.wait_for(TEXT.format("frame-heading") + " === 'Frame 5'")
        browser.wait_for(TEXT.format("contact") + " === 'live'")
        port = self.desk.port
        self.desk.kill()
        browser.wait_for("document.body.classList.contains('stale')")
        self.assertIn("No contact with the desk", browser.evaluate(TEXT.format("lost")))
        self.keep(browser, "stale")
        self.desk.start(f"127.0.0.1:{port}")
        self.desk.send(flight, self.desk.frames()[6:8])
        browser.wait_for("!document.body.classList.contains('stale')")
        browser.wait_for(TEXT.format("frame-heading") + " === 'Frame 7'")
        self.assertEqual(8, browser.evaluate("document.getElementById('frame').max * 1 + 1"))

    def test_a_break_while_a_flight_is_opened_does_not_leave_it(self):
        _, address = self.flown()
        browser = self.browse()
        browser.wait_for("document.getElementById('flights').children.length > 0")
        port = self.desk.port
        self.desk.process.send_signal(signal.SIGSTOP)
        browser.evaluate(f"location.hash = '{address}'")
        time.sleep(0.5)  # it has asked
        self.desk.kill()
        browser.wait_for("document.body.classList.contains('stale')")
        self.assertEqual(address, browser.evaluate("location.hash"))
        self.desk.start(f"127.0.0.1:{port}")
        browser.wait_for(TEXT.format("frame-heading") + " === 'Frame 5'")
        browser.evaluate("location.hash = '#000000000000'")  # there is none: back to the list
        browser.wait_for("location.hash === '' && !document.getElementById('list').hidden")

    def test_the_report_of_a_flight_is_quiet(self):
        """`nadir replay`'s page, of a flight with positions and of one without any."""
        axe = find_axe()
        for name, factor in (("good", 1), ("elsewhere", FEET)):
            header, *rows = self.desk.telemetry().splitlines()
            column = header.split(",").index("agl_m")
            rows = [",".join(str(float(value) * factor) if i == column else value for i, value in enumerate(row.split(","))) for row in rows[:5 if name == "good" else 3]]
            (self.folder / f"{name}.csv").write_text("\n".join([header, *rows]) + "\n")
            flight = self.desk.made / "flight"
            support.run("replay", "--frames", flight / "frames", "--telemetry", self.folder / f"{name}.csv", "--camera", flight / "camera.yaml",
                        "--package", self.desk.made / "package", "--trust", self.desk.made / "root.json", "--at", self.desk.at,
                        "--out", self.folder / name)
            for size in self.sizes:
                browser = Browser(*self.sizes[size])
                self.addCleanup(browser.close)
                browser.open((self.folder / name / "report.html").as_uri())
                browser.wait_for("document.getElementById('figures')?.children.length > 0")
                with self.subTest(f"{name}, {size}"):
                    if name == "good":
                        browser.wait_for("document.querySelector('#map .leaflet-image-layer')?.naturalWidth > 0")
                        before = browser.evaluate(TEXT.format("readout"))
                        browser.evaluate("dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight' }))")
                        self.assertNotEqual(before, browser.evaluate(TEXT.format("readout")))
                    else:
                        self.assertIn("No frame has a position", browser.evaluate(TEXT.format("map")))
                    self.keep(browser, f"report-{name}-{size}")
                    self.assertEqual([], browser.complaints())
                    self.assertEqual(self.sizes[size][0], browser.evaluate("document.documentElement.scrollWidth"), "it scrolls sideways")
                    if axe:
                        self.assertEqual([], browser.barriers(axe))
                browser.close()

    def test_has_no_serious_barriers(self):
        axe = find_axe()
        if axe is None:
            self.skipTest("this Python has no axe-playwright-python; see .ci/python-requirements.txt")
        flight, address = self.flown(FRAMES, complete=True)
        self.desk.json("POST", flight + "/objects", {"frame": 5, "pixel": {"x": 300, "y": 200}, "name": "well"}, 201)
        self.desk.json("POST", flight + "/fixes", {"lat": 48.7864, "lon": 14.0239, "radius_m": 50}, 201)
        for size in self.sizes:
            browser = self.browse("", size)
            browser.wait_for(TEXT.format("packages") + ".includes('valley')")
            with self.subTest("list, " + size):
                self.assertEqual([], browser.barriers(axe))
            browser = self.browse(address, size)
            browser.wait_for(SHOWN.format("image-map"))
            browser.wait_for(TEXT.format("fixes") + ".includes('Fix 1')")
            with self.subTest("flight, " + size):
                self.assertEqual([], browser.barriers(axe))
            self.key(browser, "c")
            self.key(browser, "f")
            browser.wait_for("document.querySelector('#picture-map .leaflet-image-layer')?.naturalWidth > 0")
            with self.subTest("picture beside the map, " + size):
                self.assertEqual([], browser.barriers(axe))
            self.key(browser, "d")
            browser.wait_for("document.querySelector('img.laid-picture')?.style.transform.startsWith('matrix3d')")
            with self.subTest("picture on the map, " + size):
                self.assertEqual([], browser.barriers(axe))
            browser.evaluate("document.getElementById('add').click()")
            with self.subTest("dialog, " + size):
                self.assertEqual([], browser.barriers(axe))
            browser.evaluate("document.getElementById('pictures').append(document.createElement('button'))")
            self.assertEqual(["button-name"], [found.split(":")[0] for found in browser.barriers(axe)], "the check sees what is there")

    def test_fits_its_window(self):
        _, address = self.flown(FRAMES, complete=True)
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
        print("SKIPPED: no chromium here; `apt-get install chromium-headless-shell` tests the page", file=sys.stderr)
        sys.exit(77)
    unittest.main(argv=[sys.argv[0]], verbosity=2)
