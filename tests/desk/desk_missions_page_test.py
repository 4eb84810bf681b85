#!/usr/bin/env python3
"""The missions' page in a real browser, against the real program over a simulated map: from an empty folder to a signed,
verified package, by mouse and by keyboard alone; the same package from the command line; changes of others, findings,
layers, files.

usage: desk_missions_page_test.py NADIR [FOLDER_FOR_SCREENSHOTS]
Exit code 77: there is no chromium here.
"""
import base64
import filecmp
import json
import pathlib
import sys
import time
import unittest

SCREENSHOTS = pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else None
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from desk_support import Desk, make_world  # noqa: E402
from browser import Browser, Navigated, find_axe, find_chromium  # noqa: E402
import support  # noqa: E402

TEXT = "document.getElementById('{}').textContent"
SAVED = TEXT.format("saved") + " === 'saved'"
POINTS = "document.querySelectorAll('[data-points=route] li.point').length"
STEPS = ["build", "index", "matchability", "sign", "verify", "predict"]


class MissionsPage(support.EndToEnd):
    sizes = {"phone": (390, 844, True), "laptop": (1366, 768, False), "desk": (1920, 1080, False)}

    def setUp(self):
        super().setUp()
        self.made = support.made_once("desk world", make_world)
        self.world = self.made / "world"
        self.desk = Desk(self.folder / "desk", self.made, "--imagery", self.world / "map.tif", "--dem", self.world / "dem.tif", "--camera",
                         self.world / "camera.yaml", "--vectors", self.world / "vectors.geojson", "--vectors-attribution", "the simulator", "--vectors-licence", "CC0-1.0",
                         "--key", self.made / "signer.key.pem").start()
        self.addCleanup(self.desk.stop)

    page = None

    def browse(self, address="", size="laptop"):
        """The page before it, which would go on drawing, is closed."""
        if self.page:
            self.page.close()
        self.page = Browser(*self.sizes[size])
        self.addCleanup(self.page.close)
        self.page.open(self.desk.url + "/missions" + address)
        self.page.wait_for(TEXT.format("sources") + ".includes('signer.key.pem')")
        return self.page

    def keep(self, browser, name):
        if SCREENSHOTS:
            browser.screenshot(SCREENSHOTS / f"missions-{name}.png")

    def check_quiet(self, browser, expected=()):
        """No error but those of answers that a browser notes itself; nothing asked of others."""
        self.assertEqual([], [text for text in browser.complaints() if not any(status in text for status in expected)])
        foreign = [url for url in browser.requested() if not url.startswith((self.desk.url, "data:", "blob:", "about:"))]
        self.assertEqual([], foreign, "the page asks others")

    def imported(self, more="", name="mission.yaml"):
        text = (self.world / "mission.yaml").read_text() + more
        status, _, answer = self.desk.call("POST", f"/v1/missions/import?name={name}", text.encode(), {"Content-Type": "application/octet-stream"})
        self.assertEqual(201, status, answer)
        return json.loads(answer)["mission"]

    def mission_of(self, browser):
        return self.desk.json("GET", "/v1/missions/" + browser.evaluate("location.hash.slice(1)"), expect=200)

    def finished(self, mission):
        """A page is not waited for as long as a build may take on a loaded machine."""
        while (self.desk.json("GET", f"/v1/missions/{mission}", expect=200)["job"] or {}).get("state") in ("waiting", "running"):
            time.sleep(0.3)

    # ---- By mouse

    @staticmethod
    def click(browser, selector):
        """In the middle of what a person sees of it, once it stands still (what is loaded above it moves it) and nothing lies over it."""
        def place():
            return browser.evaluate(f"""(() => {{
              const found = document.querySelector({json.dumps(selector)});
              for (let part = found.closest('details:not([open])'); part; part = part.parentElement.closest('details:not([open])'))
                if (!found.matches('summary') || part.contains(found.parentElement.closest('details'))) part.open = true;
              found.scrollIntoView({{ block: 'center' }});
              const box = found.getBoundingClientRect(), x = box.left + box.width / 2, y = box.top + box.height / 2;
              return [x, y, found.contains(document.elementFromPoint(x, y))];
            }})()""")

        for _ in range(5):  # what is loaded just now may move it under the pointer, as it would a person's
            x, y, free = place()
            for _ in range(100):
                time.sleep(0.05)
                before, (x, y, free) = (x, y), place()
                if free and before == (x, y):
                    break
            browser.evaluate(f"window.missed = true; document.querySelector({json.dumps(selector)}).addEventListener('click', () => {{ window.missed = false; }}, {{ once: true, capture: true }})")
            browser.mouse(("move", x, y), ("click", x, y))
            try:
                if not browser.evaluate("window.missed === true"):
                    return
            except Navigated:
                return
        raise AssertionError(f"{selector} is never where it was")

    def fill(self, browser, path, text):
        selector = f"#mission [data-path='{path}']"
        self.click(browser, selector)
        browser.evaluate("document.activeElement.select()")
        browser.type(text)
        browser.press("Tab")

    @staticmethod
    def spot(browser, east, north):
        """Of the map, from its middle, in shares of its shorter side, once it stands still. At the top of the page what comes and goes below does not move it."""
        where = lambda: browser.evaluate(f"""(() => {{
          document.getElementById('map').scrollIntoView({{ block: 'start' }});
          const box = document.getElementById('map').getBoundingClientRect(), side = Math.min(box.width, box.height);
          return [box.left + box.width / 2 + {east} * side, box.top + box.height / 2 - {north} * side];
        }})()""")
        before, now = None, where()
        while now != before:
            time.sleep(0.05)
            before, now = now, where()
        return now

    def draw(self, browser, tool, places, close=None):
        self.click(browser, f"[data-draw={tool}]")
        for place in places:
            x, y = self.spot(browser, *place)
            browser.mouse(("move", x, y), ("click", x, y))
        if close is not None:
            browser.wait_for(TEXT.format("asking") + f".startsWith('{len(places)} points')")
            self.click(browser, "#draw-finish")
        browser.wait_for("document.getElementById('drawing').hidden")

    def requirements(self, browser):
        for path, text in {"zoom.max": "18", "freshness_days.active": "200", "route.corridor_half_width_m": "40"}.items():
            self.fill(browser, path, text)

    def built(self, browser, steps=STEPS):
        """Waits for the job: every one of these steps is done."""
        browser.wait_for("!document.getElementById('cancel-job').hidden || " + TEXT.format("state") + " === 'signed'")
        self.finished(browser.evaluate("location.hash.slice(1)"))
        browser.wait_for(TEXT.format("state") + " === 'signed' && document.getElementById('cancel-job').hidden")
        mission = self.mission_of(browser)
        self.assertEqual([(step, "done") for step in steps], [(step["kind"], step["state"]) for step in mission["job"]["steps"]], mission["job"])
        self.assertIn("cache sign", browser.evaluate("document.querySelector('[data-step=sign] pre').textContent"))
        browser.wait_for("document.querySelector('.vectors-switch')")  # the package's roads and water are drawn
        return mission

    def compared_with_the_command_line(self, mission):
        """The package is what the commands make of the same file, byte for byte."""
        package, exported, world = self.folder / "by-hand", self.folder / "mission.yaml", self.world
        exported.write_bytes(self.desk.call("GET", f"/v1/missions/{mission['id']}/file?format=yaml")[2])
        for words in (["cache", "build", "--mission", exported, "--imagery", world / "map.tif", "--dem", world / "dem.tif", "--vectors", world / "vectors.geojson",
                       "--vectors-attribution", "the simulator", "--vectors-licence", "CC0-1.0", "--at", self.desk.at, "--out", package],
                      ["cache", "index", package, "--camera", world / "camera.yaml"],
                      ["cache", "matchability", package, "--into-package", "--camera", world / "camera.yaml"],
                      ["cache", "sign", package, "--key", self.made / "signer.key.pem", "--trust", self.made / "root.json"]):
            result = support.run(*words)
            self.assertEqual(0, result.returncode, result.stderr)
        page = self.desk.root / "packages" / mission["package"]["name"]
        files = sorted(str(path.relative_to(page)) for path in page.rglob("*") if path.is_file())
        self.assertEqual(files, sorted(str(path.relative_to(package)) for path in package.rglob("*") if path.is_file()))
        self.assertEqual(([], []), filecmp.cmpfiles(package, page, files, shallow=False)[1:])

    def made_by_mouse(self, size):
        browser = self.browse(size=size)
        browser.wait_for(TEXT.format("missions") + " === 'none yet'")
        self.keep(browser, f"empty-{size}")
        self.click(browser, "#new")
        browser.type("Harbour, east side")
        self.click(browser, "#create-form [type=submit]")
        browser.wait_for("!document.getElementById('mission').hidden")
        browser.wait_for("document.querySelectorAll('#findings li.refuse').length === 2")  # no take-off, no ground

        self.draw(browser, "takeoff", [(-.2, -.2)])
        browser.wait_for(SAVED)
        self.draw(browser, "route", [(-.2, -.2), (.2, -.2), (.2, .1), (-.1, .1)], close=True)
        self.assertEqual(4, browser.evaluate(POINTS))
        # The first point snapped to the take-off.
        browser.wait_for(SAVED)
        document = self.mission_of(browser)["mission"]
        self.assertEqual([document["takeoff"]["lon_deg"], document["takeoff"]["lat_deg"]], document["route"]["points"][0])
        self.draw(browser, "area", [(.05, -.1), (.15, -.1), (.15, 0), (.05, 0)], close=True)
        self.draw(browser, "circle", [(-.3, .3)])
        browser.wait_for("document.querySelectorAll('#sectors .part').length === 1 && document.querySelectorAll('#no-fly .part').length === 1")

        # A point is dragged; undone, and done again.
        self.click(browser, "[data-points=route] li:nth-child(3) .number")
        latitude = "document.querySelector('[data-points=route] li:nth-child(3) [data-axis=lat]').value"
        before = browser.evaluate(latitude)
        (x, y), (_, higher) = self.spot(browser, .2, .1), self.spot(browser, .2, .2)
        browser.mouse(("move", x, y), ("down", x, y), ("move", x, (y + higher) / 2), ("move", x, higher), ("up", x, higher))
        browser.wait_for(f"Number({latitude}) > {before}")
        after = browser.evaluate(latitude)
        self.click(browser, "#undo")
        browser.wait_for(f"{latitude} === '{before}'")
        self.click(browser, "#redo")
        browser.wait_for(f"{latitude} === '{after}'")
        # Halfway between two points a new one is drawn out.
        (x, y), (_, lower) = self.spot(browser, 0, -.2), self.spot(browser, 0, -.25)
        browser.mouse(("move", x, y), ("down", x, y), ("move", x, (y + lower) / 2), ("move", x, lower), ("up", x, lower))
        browser.wait_for(POINTS + " === 5")

        # Heights of the points, in metres, with feet beside them.
        browser.evaluate("""(() => { const frame = document.getElementById('height-frame'); frame.value = 'above_ground'; frame.dispatchEvent(new Event('change', { bubbles: true })); })()""")
        self.click(browser, "[data-points=route] li:nth-child(2) [data-axis=height]")
        browser.evaluate("document.activeElement.select()")
        browser.type("130")
        browser.press("Tab")
        self.assertEqual("427 ft", browser.evaluate("document.querySelector('[data-points=route] li:nth-child(2) .feet').textContent"))
        self.requirements(browser)
        browser.evaluate("""(() => { const terrain = document.querySelector('[data-path="terrain.mode"]'); terrain.value = 'dem'; terrain.dispatchEvent(new Event('change', { bubbles: true })); })()""")
        browser.wait_for(SAVED)
        browser.wait_for("Number(document.getElementById('estimate-tiles').textContent) > 20")
        browser.wait_for(TEXT.format("profile-text") + ".includes('above ground')")
        self.keep(browser, f"drawn-{size}")
        if size == "laptop":
            self.click(browser, "#run-steps")
            self.compared_with_the_command_line(self.built(browser))
        else:  # a phone's hand draws the same, and leaves a step out
            self.click(browser, "[data-step=index] input")
            self.click(browser, "#run-steps")
            self.built(browser, [step for step in STEPS if step != "index"])
        mission = self.mission_of(browser)
        self.assertEqual([120, 130, 120, 120, 120], mission["mission"]["route"]["heights"]["m"])
        self.keep(browser, f"signed-{size}")

        # Fly it: the flights' room, with this package.
        self.click(browser, "#fly")
        browser.wait_for("document.getElementById('create')?.open")
        self.assertEqual("Harbour-east-side-1", browser.evaluate("document.getElementById('create-package').value"))
        self.assertEqual("Flights", browser.evaluate("document.querySelector('nav [aria-current]').textContent"))
        self.check_quiet(browser)

    def test_by_mouse_at_a_laptop(self):
        self.made_by_mouse("laptop")

    def test_by_finger_sized_clicks_at_a_phone(self):
        self.made_by_mouse("phone")

    # ---- By keyboard alone

    def tab_to(self, browser, selector, key="Tab"):
        for _ in range(400):
            if browser.evaluate(f"document.activeElement.matches({json.dumps(selector)})"):
                return
            browser.press(key)
        self.fail(f"Tab does not lead to {selector}")

    def enter(self, browser, selector, text):
        self.tab_to(browser, selector)
        browser.evaluate("document.activeElement.select()")
        browser.type(text)

    def test_by_keyboard_alone(self):
        browser = self.browse(size="desk")
        self.tab_to(browser, "#new")
        browser.press("Enter")
        browser.wait_for("document.activeElement.id === 'create-name'")
        browser.type("By keys")
        browser.press("Enter")
        browser.wait_for("!document.getElementById('mission').hidden")

        # On the map: Enter is the middle, arrow keys move the map.
        self.tab_to(browser, "[data-draw=route]")
        browser.press("Enter")
        browser.wait_for("document.activeElement.id === 'map'")
        for keys in (["ArrowDown"], ["ArrowRight", "ArrowRight"], ["ArrowUp", "ArrowUp"]):
            for key in keys:
                browser.press(key)
                time.sleep(0.5)  # it moves smoothly
            browser.press("Enter")
        browser.press("Enter")  # one too many
        browser.wait_for(TEXT.format("asking") + ".startsWith('4 points')")
        browser.press("Backspace")
        browser.wait_for(TEXT.format("asking") + ".startsWith('3 points')")
        browser.press("f")
        browser.wait_for(POINTS + " === 3")
        browser.press("t", "Enter")
        browser.wait_for(TEXT.format("history-answer") + " !== null && document.querySelector('[data-path=\"takeoff.lat_deg\"]').value !== ''")

        # A point is moved by arrow keys, as one step.
        self.tab_to(browser, "[data-points=route] li:nth-child(2) .number")
        latitude = "Number(document.querySelector('[data-points=route] li:nth-child(2) [data-axis=lat]').value)"
        before = browser.evaluate(latitude)
        browser.press("Enter", "ArrowUp", "ArrowUp", "Shift+ArrowUp")
        browser.wait_for(f"{latitude} > {before}")
        browser.press("z")
        browser.wait_for(f"{latitude} === {before}")
        browser.press("y")
        browser.wait_for(f"{latitude} > {before}")

        # An area by numbers.
        lat, lon = browser.evaluate("['lat', 'lon'].map((axis) => Number(document.querySelector(`[data-points=route] li:nth-child(1) [data-axis=${axis}]`).value))")
        self.tab_to(browser, "#add-sector")
        browser.press("Enter")
        browser.wait_for("document.activeElement.matches('#sectors [data-what=add]')")
        for index, (north, east) in enumerate(((0, 0), (0, .0008), (.0005, .0008), (.0005, 0))):
            self.tab_to(browser, "#sectors [data-what=add]")
            browser.press("Enter")
            browser.wait_for(f"document.activeElement.matches('#sectors li.point:nth-child({index + 1}) [data-axis=lat]')")
            self.enter(browser, f"#sectors li.point:nth-child({index + 1}) [data-axis=lat]", f"{lat + north:.6f}")
            self.enter(browser, f"#sectors li.point:nth-child({index + 1}) [data-axis=lon]", f"{lon + east:.6f}")
        self.tab_to(browser, "[data-part=requirements] > summary")
        browser.press("Enter")
        self.tab_to(browser, "[data-path='terrain.mode']")
        browser.press("ArrowUp")
        for path, text in {"zoom.max": "18", "freshness_days.active": "200"}.items():
            self.enter(browser, f"[data-path='{path}']", text)
        self.tab_to(browser, "[data-path='route.corridor_half_width_m']", "Shift+Tab")
        browser.evaluate("document.activeElement.select()")
        browser.type("40")
        self.tab_to(browser, "#snapping", "Shift+Tab")
        browser.wait_for(SAVED)
        browser.wait_for(TEXT.format("state") + " === 'complete'")
        self.keep(browser, "keys")
        browser.press("g")
        mission = self.built(browser)
        self.assertEqual("dem", mission["mission"]["terrain"]["mode"])
        self.assertEqual(40, mission["mission"]["route"]["corridor_half_width_m"])
        self.assertEqual(5, len(mission["mission"]["sectors"][0]["polygon"]))
        self.check_quiet(browser)

    # ---- Others, and mistakes

    def test_what_others_change_loses_nothing(self):
        mission = self.imported()
        path = f"/v1/missions/{mission['id']}"
        browser = self.browse("#" + mission["id"])
        browser.wait_for(TEXT.format("name") + " === 'world-7'")

        def by_another(**more):
            now = self.desk.json("GET", path, expect=200)
            self.desk.json("PUT", path, {"revision": now["revision"], "mission": now["mission"] | more}, 200)

        def both_change(resolution_m, **others):
            """The page's change is on its way when another's arrives: one that it hears of before, it would show."""
            browser.evaluate("""(() => {
              const send = window.fetch;
              let release;
              const released = new Promise((done) => { release = done; });
              window.releaseChanges = () => { window.fetch = send; release(); };
              window.fetch = async (address, options) => {
                if (options?.method === "PUT") await released;
                return send(address, options);
              };
            })()""")
            self.fill(browser, "min_resolution_m", resolution_m)
            browser.wait_for(TEXT.format("saved") + ".startsWith('saving')")
            by_another(**others)
            browser.evaluate("window.releaseChanges()")
            browser.wait_for("!document.getElementById('conflict').hidden")

        both_change("0.7", budget_mb=111)
        self.keep(browser, "conflict")
        self.assertEqual(111, self.desk.json("GET", path, expect=200)["mission"]["budget_mb"], "nothing of the other is overwritten unasked")
        self.click(browser, "#conflict-theirs")
        browser.wait_for(SAVED)
        browser.wait_for("document.querySelector('[data-path=budget_mb]').value === '111'")
        self.click(browser, "#undo")  # and mine is still there
        browser.wait_for("document.querySelector('[data-path=min_resolution_m]').value === '0.7'")
        browser.wait_for(SAVED)

        both_change("0.8", budget_mb=222)
        self.click(browser, "#conflict-mine")
        browser.wait_for(SAVED)
        now = self.desk.json("GET", path, expect=200)["mission"]
        self.assertEqual((500, 0.8), (now["budget_mb"], now["min_resolution_m"]))

        # What another one changes while nothing is done here is shown.
        by_another(budget_mb=333)
        browser.wait_for("document.querySelector('[data-path=budget_mb]').value === '333'")

        # Without the desk: it is marked, and stored when it is back.
        port = self.desk.port
        self.desk.kill()
        self.fill(browser, "budget_mb", "444")
        browser.wait_for(TEXT.format("saved") + ".startsWith('not saved')")
        browser.wait_for("document.body.classList.contains('stale')")
        self.desk.start(f"127.0.0.1:{port}")
        browser.wait_for(SAVED)
        self.assertEqual(444, self.desk.json("GET", path, expect=200)["mission"]["budget_mb"])
        self.check_quiet(browser, ("status of 409", "ERR_CONNECTION", "ERR_EMPTY_RESPONSE"))

    def test_findings_are_where_they_are(self):
        mission = self.imported("integrity: {alert_limit_m: 20}\n")
        browser = self.browse("#" + mission["id"])
        browser.wait_for(TEXT.format("name") + " === 'world-7'")
        self.click(browser, "[data-points=route] li:nth-child(2) [data-axis=lat]")
        browser.evaluate("document.activeElement.select()")
        browser.type("95")
        browser.press("Tab")
        browser.wait_for("document.querySelector('[data-points=route] li:nth-child(2) [data-axis=lat]').getAttribute('aria-invalid') === 'true'")
        self.assertIn("found \"95\"", browser.evaluate("document.querySelector('[data-points=route] li:nth-child(2) .at-member').textContent"))
        self.assertTrue(browser.evaluate("document.getElementById('run-steps').disabled"))
        self.click(browser, "#undo")
        browser.wait_for("document.querySelectorAll('#findings li.refuse').length === 0")
        # A text that is no number stays, and says so.
        self.fill(browser, "budget_mb", "much")
        browser.wait_for("document.querySelector('[data-path=budget_mb]').getAttribute('aria-invalid') === 'true'")
        self.click(browser, "#undo")
        browser.wait_for("document.querySelectorAll('#findings li.refuse').length === 0")
        self.keep(browser, "findings")
        # Ground that the imagery does not cover: the build's own findings, with their tiles.
        self.click(browser, "[data-points=route] li:nth-child(7) [data-what=insert]")
        browser.wait_for(POINTS + " === 8")
        for axis, text in (("lon", "14.0385"), ("lat", "48.7895")):
            self.click(browser, f"[data-points=route] li:nth-child(8) [data-axis={axis}]")
            browser.evaluate("document.activeElement.select()")
            browser.type(text)
            browser.press("Tab")
        browser.wait_for(SAVED)
        self.click(browser, "#run-steps")
        browser.wait_for("document.querySelector('[data-step=build] .chip').textContent === 'rejected'")
        browser.wait_for("document.querySelectorAll('#findings li.refuse').length > 0")
        self.assertIsNone(self.mission_of(browser)["package"])
        self.click(browser, "#findings li:last-child button")
        self.keep(browser, "rejected")
        self.check_quiet(browser)

    # ---- What is shown

    LONGITUDE = "Number(document.querySelector('[data-points=route] li:nth-child(1) [data-axis=lon]').value)"

    def handles(self, browser):
        """Where the first two points of the selected part are, in pixels of the window, once the map stands still."""
        browser.wait_for("document.querySelectorAll('.leaflet-vertex-icon').length > 1")
        where = lambda: browser.evaluate("""(() => {
          document.getElementById('map').scrollIntoView({ block: 'nearest' });
          return [...document.querySelectorAll('.leaflet-vertex-icon')].filter((icon) => !icon.classList.contains('leaflet-middle-icon')).slice(0, 2)
            .map((icon) => icon.getBoundingClientRect()).map((box) => [box.left + box.width / 2, box.top + box.height / 2]);
        })()""")
        last, now = None, where()
        while now != last:
            time.sleep(.3)
            last, now = now, where()
        return now

    def test_a_finger_drags_a_point_a_part_and_the_map(self):
        browser = self.browse("#" + self.imported()["id"], size="phone")
        browser.wait_for(POINTS + " > 1")  # the sources may be there before the mission is
        points = lambda: self.mission_of(browser)["mission"]["route"]["points"]
        before = points()
        self.click(browser, "[data-points=route] li:nth-child(1) .number")

        (x, y), _ = self.handles(browser)
        browser.drag_by_finger((x, y), (x + 10, y), (x + 25, y))
        browser.wait_for(f"{self.LONGITUDE} > {before[0][0]} + 1e-6")
        browser.wait_for(SAVED)
        self.assertEqual(before[1:], points()[1:], "the first point alone")
        self.click(browser, "#undo")
        browser.wait_for(f"{self.LONGITUDE} === {before[0][0]}")
        browser.wait_for(SAVED)

        a, b = self.handles(browser)
        x, y = (a[i] + .3 * (b[i] - a[i]) for i in (0, 1))
        browser.drag_by_finger((x, y), (x + 15, y), (x + 30, y))
        browser.wait_for(f"{self.LONGITUDE} > {before[0][0]} + 1e-6")
        browser.wait_for(SAVED)
        moved = points()
        for old, new in zip(before, moved, strict=True):
            self.assertAlmostEqual(old[0] + moved[0][0] - before[0][0], new[0], delta=2e-7)
        (shown, _), _ = self.handles(browser)

        # Beside all parts it is the map that moves.
        x, y = self.spot(browser, -.45, .45)
        browser.drag_by_finger((x, y), (x + 10, y), (x + 40, y))
        browser.wait_for(f"Math.abs(document.querySelector('.leaflet-vertex-icon').getBoundingClientRect().left - {shown}) > 15")
        self.assertEqual(moved, points())
        self.check_quiet(browser)

    def test_coverage_before_a_build_and_whole_parts_that_move(self):
        browser = self.browse("#" + self.imported()["id"])
        covered = TEXT.format("coverage-answer")
        browser.wait_for(covered + ".startsWith('The imagery covers all')")
        self.assertEqual("No package yet.", browser.evaluate(TEXT.format("package-facts")))
        points = lambda: self.mission_of(browser)["mission"]["route"]["points"]
        before = points()

        # The route as a whole, dragged by its line, a third of the way from its first handle to its second one.
        longitude = self.LONGITUDE
        self.click(browser, "[data-points=route] li:nth-child(1) .number")
        a, b = self.handles(browser)
        x, y = (a[i] + .3 * (b[i] - a[i]) for i in (0, 1))
        browser.mouse(("move", x, y), ("down", x, y), ("move", x + 30, y), ("move", x + 60, y - 20), ("up", x + 60, y - 20))
        browser.wait_for(f"{longitude} > {before[0][0]} + 1e-6")
        browser.wait_for(SAVED)
        moved = points()
        east, north = moved[0][0] - before[0][0], moved[0][1] - before[0][1]
        self.assertGreater(east, 0)
        self.assertGreater(north, 0)
        for old, new in zip(before, moved, strict=True):
            self.assertAlmostEqual(old[0] + east, new[0], delta=2e-7)
            self.assertAlmostEqual(old[1] + north, new[1], delta=2e-6)  # the same pixels are fewer metres farther north
        self.click(browser, "#undo")
        browser.wait_for(f"{longitude} === {before[0][0]}")
        browser.wait_for(SAVED)
        self.assertEqual(before, points(), "one step")

        # By keys, far to the east: out of the imagery, which is said and drawn.
        browser.evaluate("document.getElementById('map').focus()")
        browser.press(*["Control+Shift+ArrowRight"] * 30)
        browser.wait_for(covered + ".includes('no imagery on')")
        self.assertGreater(points()[0][0], before[0][0])
        self.keep(browser, "coverage")
        self.click(browser, "#layer-coverage")
        self.keep(browser, "coverage-hidden")
        browser.evaluate("document.getElementById('map').focus()")
        browser.press("z")
        browser.wait_for(covered + ".startsWith('The imagery covers all')")
        browser.wait_for(SAVED)
        self.assertEqual(before, points(), "keys that follow each other are one step")

        # An area by keys, as a whole.
        polygon = self.mission_of(browser)["mission"]["sectors"][0]["polygon"]
        latitude = "Number(document.querySelector('#sectors li.point:nth-child(1) [data-axis=lat]').value)"
        self.click(browser, "#sectors li.point:nth-child(1) .number")
        browser.evaluate("document.getElementById('map').focus()")
        browser.press("Control+ArrowUp")
        browser.wait_for(f"{latitude} > {polygon[0][1]}")
        browser.wait_for(SAVED)
        changed = self.mission_of(browser)["mission"]["sectors"][0]["polygon"]
        self.assertEqual(changed[0], changed[-1])
        for old, new in zip(polygon, changed, strict=True):
            self.assertAlmostEqual(old[0], new[0], delta=2e-7)
            self.assertGreater(new[1], old[1])
        self.check_quiet(browser)

    def test_layers_barriers_and_windows(self):
        mission = self.imported("integrity: {alert_limit_m: 10}\n")
        self.desk.json("POST", f"/v1/missions/{mission['id']}/jobs", {"steps": [step for step in STEPS if step != "index"], "imagery": ["map.tif"], "elevation": "dem.tif", "camera": "camera.yaml", "key": "signer.key.pem"}, 201)
        self.finished(mission["id"])
        axe = find_axe()
        for size, (width, _, _) in self.sizes.items():
            browser = self.browse("", size)
            browser.wait_for("document.querySelectorAll('#missions li a').length === 1")
            with self.subTest("list, " + size):
                self.assertEqual([], browser.barriers(axe) if axe else [])
            browser.evaluate("document.querySelector('#missions a').click()")
            browser.wait_for(TEXT.format("state") + " === 'signed' && document.getElementById('cancel-job').hidden")
            # Legs beyond the alert limit, with the reason.
            browser.wait_for("document.querySelector('#legs li.refuse') !== null")
            self.click(browser, "#legs li.refuse button")
            browser.wait_for(TEXT.format("layer-answer") + ".startsWith('Beyond the alert limit')")
            self.assertIn("Why:", browser.evaluate(TEXT.format("layer-answer")))
            for fact, legend in {"coverage": "gap in what the mission needs", "freshness": "too old", "resolution": "too coarse", "provider": "nadir simulate world", "matchability": "not evaluated"}.items():
                self.click(browser, f"input[name=fact][value={fact}]")
                browser.wait_for(TEXT.format("legend") + f".includes('{legend}')")
            self.click(browser, "#layer-footprint")
            self.click(browser, "#profile-at")
            browser.wait_for(TEXT.format("profile-text") + ".includes('predicted protection level')")
            self.assertRegex(browser.evaluate(TEXT.format("profile-text")), r"131 m \(430 ft\) above ground; ground \d+ m \(\d+ ft\); camera sees 167 m × 94 m")
            with self.subTest("mission, " + size):
                self.assertEqual([], browser.barriers(axe) if axe else [])
                self.assertEqual(width, browser.evaluate("document.documentElement.scrollWidth"), "it scrolls sideways")
                cut = browser.evaluate("[...document.querySelectorAll('main *')].filter((e) => e.scrollWidth > e.clientWidth + 1 && e.clientWidth > 0 && !e.matches('select, input')).map((e) => e.id || e.tagName)")
                self.assertEqual([], cut, "text that does not fit")
                unnamed = browser.evaluate("[...document.querySelectorAll('button, input, select')].filter((e) => !(e.textContent.trim() || e.getAttribute('aria-label') || e.getAttribute('aria-labelledby') || e.labels?.length)).map((e) => e.outerHTML)")
                self.assertEqual([], unnamed, "controls without a name")
            if size == "laptop":  # the legs lie over the route, and are no obstacle
                self.click(browser, "[data-points=route] li:nth-child(1) .number")
                before = browser.evaluate(self.LONGITUDE)
                a, b = self.handles(browser)
                x, y = (a[i] + .3 * (b[i] - a[i]) for i in (0, 1))
                browser.mouse(("move", x, y), ("down", x, y), ("move", x + 30, y), ("move", x + 60, y), ("up", x + 60, y))
                browser.wait_for(f"{self.LONGITUDE} > {before} + 1e-6")
                browser.wait_for(SAVED)
                self.click(browser, "#undo")
                browser.wait_for(f"{self.LONGITUDE} === {before}")
                browser.wait_for(SAVED)
            self.click(browser, "[data-draw=area]")
            browser.wait_for("!document.getElementById('drawing').hidden")
            with self.subTest("drawing, " + size):
                self.assertEqual([], browser.barriers(axe) if axe else [])
            self.keep(browser, size)
            browser.press("Escape")
            self.check_quiet(browser)

        # The package stands in the way of a second one: the next sequence has room.
        self.click(browser, "#next-sequence")
        browser.wait_for(SAVED)
        browser.wait_for(TEXT.format("package-facts") + " === 'No package yet.'")
        self.click(browser, "#run-steps")
        browser.wait_for("!document.getElementById('cancel-job').hidden")
        self.click(browser, "#cancel-job")
        browser.wait_for("document.getElementById('cancel-job').hidden")
        self.assertIn(self.mission_of(browser)["job"]["state"], ("cancelled", "done"))
        self.check_quiet(browser)

    def test_files_in_and_out(self):
        browser = self.browse()
        mission = self.imported()
        plan = self.desk.call("GET", f"/v1/missions/{mission['id']}/file?format=plan")[2]
        for name, data, found in (("survey.plan", plan, True), ("broken.kml", b"<kml", False)):
            browser.evaluate(f"""(() => {{
              const dropped = new DataTransfer();
              dropped.items.add(new File([Uint8Array.from(atob('{base64.b64encode(data).decode()}'), (c) => c.charCodeAt(0))], '{name}'));
              document.getElementById('list').dispatchEvent(new DragEvent('drop', {{ bubbles: true, cancelable: true, dataTransfer: dropped }}));
            }})()""")
            browser.wait_for("document.getElementById('import-dialog').open")
            self.assertIn(name, browser.evaluate(TEXT.format("import-chosen")))
            self.click(browser, "#import-send")
            if not found:
                browser.wait_for(TEXT.format("import-problem") + " !== ''")
                self.keep(browser, "import")
                self.click(browser, "#import-cancel")
                continue
            browser.wait_for("!document.getElementById('mission').hidden")
            self.assertEqual(mission["mission"]["route"]["points"], self.mission_of(browser)["mission"]["route"]["points"])
            # What is saved is what the desk says.
            browser.evaluate("""(() => {
              window.saved = [];
              HTMLAnchorElement.prototype.click = function () { window.saved.push(this.download); };
              const address = URL.createObjectURL;
              URL.createObjectURL = (blob) => { blob.text().then((text) => { window.text = text; }); return address.call(URL, blob); };
            })()""")
            for format_name in ("plan", "waypoints", "kml", "kmz", "geojson", "gpkg", "yaml"):
                browser.evaluate(f"document.querySelector('[data-export={format_name}]').click()")
                browser.wait_for(f"window.saved.at(-1)?.endsWith('.{format_name}')")
            browser.wait_for("window.text?.startsWith('#') || window.text?.includes('schema: nadir.mission/1')")
            # Heights that are counted from different grounds, point by point; a new point takes the frame of the one before it.
            for selector, value in (("#height-frame", "each"), ("[data-points=route] [data-index='1'] [data-axis=frame]", "above_sea_level")):
                browser.evaluate(f"(() => {{ const found = document.querySelector({json.dumps(selector)}); found.value = '{value}'; found.dispatchEvent(new Event('change', {{ bubbles: true }})); }})()")
            browser.evaluate("document.querySelector(\"[data-points=route] [data-index='1'] [data-what=insert]\").click()")
            browser.wait_for(SAVED)
            heights = self.mission_of(browser)["mission"]["route"]["heights"]
            self.assertEqual(["above_sea_level"] * 2, heights["frames"][1:3])
            self.assertNotIn("frame", heights)
            self.assertEqual(len(mission["mission"]["route"]["points"]) + 1, len(heights["m"]))
            browser.evaluate("location.hash = ''")
            browser.wait_for("!document.getElementById('list').hidden")
        self.check_quiet(browser, ("status of 422",))


if __name__ == "__main__":
    if not find_chromium():
        print("SKIPPED: no chromium here; `apt-get install chromium-headless-shell` tests the page", file=sys.stderr)
        sys.exit(77)
    unittest.main(argv=[sys.argv[0]], verbosity=2)
