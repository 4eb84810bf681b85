"""A headless Chromium over its debugging pipe: no port, no web socket, no package beyond the standard library."""
import atexit
import base64
import importlib.util
import json
import os
import pathlib
import select
import shutil
import subprocess
import tempfile
import time

PATIENCE_S = 90  # a loaded machine starts a browser slowly; every wait ends as soon as it can


def find_chromium():
    """The one without a browser's own windows where there is one: it renders the same pages for half of the CPU time."""
    names = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
    return next((path for name in names if (path := shutil.which(name))), None)


def find_axe():
    """The text of axe-core, or None: this Python has no axe-playwright-python (nothing else of it is used)."""
    package = importlib.util.find_spec("axe_playwright_python")
    return (pathlib.Path(package.origin).parent / "axe.min.js").read_text() if package else None


class Navigated(RuntimeError):
    """The page that was asked has gone: another is loading in its place."""

    words = ("navigated or closed", "context was destroyed", "Cannot find context", "Promise was collected")


# What a browser for people does beside the page: a list under the address bar of every window, which is a page of its own
# and costs more than most of ours, and a process held ready for the next page.
ASIDE = ("WebUIOmniboxPopup", "WebUIOmniboxAimPopup", "SpareRendererForSitePerProcess")


class Chromium:
    """One process for all pages of a test program: most of a short test would be its start."""

    running = None

    @classmethod
    def shared(cls):
        if cls.running is None:
            cls.running = cls()
            atexit.register(cls.running.end)
        return cls.running

    def __init__(self):
        self._profile = tempfile.mkdtemp(prefix="nadir-browser.")
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        command = [find_chromium(), "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
                   "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-extensions",
                   "--hide-scrollbars", "--disable-dev-shm-usage", "--no-startup-window", f"--user-data-dir={self._profile}",
                   f"--disable-features={','.join(ASIDE)}", "--remote-debugging-pipe"]
        # The browser reads from handle 3 and writes to handle 4.
        self._process = subprocess.Popen(["bash", "-c", f'exec "$@" 3<&{to_browser} 4>&{from_browser}', "browser", *command],
                                         pass_fds=(to_browser, from_browser), stdin=subprocess.DEVNULL,
                                         stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(to_browser)
        os.close(from_browser)
        self._rest, self._last_id = b"", 0
        self.heard = {}  # what each session said by itself

    def ask(self, method, params, session=None):
        self._last_id += 1
        message = {"id": self._last_id, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + PATIENCE_S
        while (left_s := deadline - time.monotonic()) > 0:
            found = None
            for answer in self._read(left_s):
                if answer.get("id") == self._last_id:
                    found = answer
                elif answer.get("sessionId") in self.heard:
                    self.heard[answer["sessionId"]].append(answer)
            if found:
                if "error" in found:
                    kind = Navigated if any(words in found["error"]["message"] for words in Navigated.words) else RuntimeError
                    raise kind(f"{method}: {found['error']}")
                return found["result"]
        raise TimeoutError(method)

    def _read(self, patience_s):
        if select.select([self._in], [], [], patience_s)[0]:
            piece = os.read(self._in, 1 << 20)
            if not piece:
                raise RuntimeError("the browser has ended")
            self._rest += piece
        *whole, self._rest = self._rest.split(b"\0")
        return [json.loads(text) for text in whole]

    def end(self):
        self._process.terminate()
        self._process.wait()
        os.close(self._in)
        os.close(self._out)
        shutil.rmtree(self._profile, ignore_errors=True)


class Browser:
    """A page in a context of its own: no other test's storage, cache or cookies."""

    def __init__(self, width, height, mobile=False):
        self._chromium = Chromium.shared()
        self._context = self._chromium.ask("Target.createBrowserContext", {})["browserContextId"]
        target = self._chromium.ask("Target.createTarget", {"url": "about:blank", "browserContextId": self._context})["targetId"]
        self._session = self._chromium.ask("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        self.messages = self._chromium.heard.setdefault(self._session, [])
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._ask(f"{domain}.enable", {})
        self._ask("Emulation.setFocusEmulationEnabled", {"enabled": True})  # whatever other pages are open
        self._ask("Emulation.setDeviceMetricsOverride",
                  {"width": width, "height": height, "deviceScaleFactor": 2 if mobile else 1, "mobile": mobile})
        self._ask("Emulation.setTouchEmulationEnabled", {"enabled": mobile})

    def _ask(self, method, params):
        return self._chromium.ask(method, params, self._session)

    def open(self, url):
        self._ask("Page.navigate", {"url": url})

    def evaluate(self, expression):
        result = self._ask("Runtime.evaluate", {"expression": expression, "returnByValue": True, "awaitPromise": True})
        if "exceptionDetails" in result:
            raise RuntimeError(result["exceptionDetails"])
        return result["result"].get("value")

    def wait_for(self, expression):
        """Until the expression is true; its value. The page looks by itself: each question from here passes through several processes."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            try:
                found = self.evaluate(f"""(async () => {{
                  for (const end = performance.now() + 3000; performance.now() < end; await new Promise((done) => setTimeout(done, 100))) {{
                    try {{ const value = {expression}; if (value) return [value]; }} catch {{}}
                  }}
                  return null;
                }})()""")
            except Navigated:  # asked of a page that has just made way for the next
                time.sleep(0.05)
                continue
            if found:
                return found[0]
        text = self.evaluate("document.body.innerText")
        raise TimeoutError(f"never true: {expression}\nThe page shows:\n{text}\nIts console: {self.complaints()}")

    def mouse(self, *moves):
        """As a hand does: each (kind, x, y) with kind "down", "up", "move" or "click", in pixels of the window."""
        held = 0
        for kind, x, y in moves:
            for step in ("down", "up") if kind == "click" else (kind,):
                held = {"down": 1, "up": 0}.get(step, held)
                self._ask("Input.dispatchMouseEvent", {"type": {"down": "mousePressed", "up": "mouseReleased", "move": "mouseMoved"}[step], "x": x, "y": y,
                                                       "button": "none" if step == "move" and not held else "left", "buttons": held, "clickCount": 0 if step == "move" else 1})

    def drag_by_finger(self, *places):
        """From the first place over the others to the last, each (x, y) in pixels of the window."""
        for kind, point in [("touchStart", places[0]), *(("touchMove", place) for place in places[1:]), ("touchEnd", None)]:
            self._ask("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": point[0], "y": point[1]}] if point else []})

    def press(self, *keys):
        """Each key goes to what has the focus: a character, or a name such as "Enter", "Shift+Tab" or "Control+Shift+ArrowUp"."""
        codes = {"Enter": 13, "Tab": 9, "Escape": 27, "Backspace": 8, "Delete": 46, " ": 32, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40}
        texts, bits = {"Enter": "\r"}, {"Control": 2, "Shift": 8}
        for key in keys:
            name, modifiers = key, 0
            while (held := name.split("+")[0]) in bits and held != name:
                name, modifiers = name.removeprefix(held + "+"), modifiers | bits[held]
            text = texts.get(name, name if len(name) == 1 else "")
            event = {"key": name, "code": name if len(name) > 1 else "", "modifiers": modifiers, "windowsVirtualKeyCode": codes.get(name, ord(name.upper()) if len(name) == 1 else 0)}
            self._ask("Input.dispatchKeyEvent", {"type": "keyDown" if text else "rawKeyDown", **event, **({"text": text} if text else {})})
            self._ask("Input.dispatchKeyEvent", {"type": "keyUp", **event})

    def type(self, text):
        self._ask("Input.insertText", {"text": text})

    def barriers(self, axe):
        """What axe-core finds in the page that is a serious or critical barrier to some people: rule, element, and why."""
        self.evaluate(axe + "; undefined")
        found = self.evaluate("""axe.run(document, { resultTypes: ['violations'] }).then(({ violations }) => violations
          .filter(({ impact }) => impact === 'serious' || impact === 'critical')
          .flatMap(({ id, nodes }) => nodes.map((node) => `${id}: ${node.target.join(' ')}: ${node.failureSummary.replaceAll('\\n', ' ')}`)))""")
        return found

    def complaints(self):
        """What the page's console and the browser's log hold against it."""
        found = []
        for message in self.messages:
            if message.get("method") == "Runtime.exceptionThrown":
                details = message["params"]["exceptionDetails"]
                found.append(details.get("exception", {}).get("description") or details["text"])
            if message.get("method") == "Log.entryAdded" and message["params"]["entry"]["level"] == "error":
                found.append(message["params"]["entry"]["text"] + " " + message["params"]["entry"].get("url", ""))
        return found

    def requested(self):
        return [message["params"]["request"]["url"] for message in self.messages
                if message.get("method") == "Network.requestWillBeSent"]

    def screenshot(self, path, whole=False):
        shot = self._ask("Page.captureScreenshot", {"format": "png", "captureBeyondViewport": whole})
        path.write_bytes(base64.b64decode(shot["data"]))

    def close(self):
        """Once or more. What it said can still be read."""
        if self._session not in self._chromium.heard:
            return
        self._chromium.ask("Target.disposeBrowserContext", {"browserContextId": self._context})
        del self._chromium.heard[self._session]
