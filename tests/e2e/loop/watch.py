"""Polls the service's API a few times a second and keeps the changes."""
import json
import threading
import time
import urllib.error
import urllib.request

PERIOD_S = 0.25


class Watch(threading.Thread):
    def __init__(self, url, program=None):
        """url: of the service, "http://127.0.0.1:8480". program: whose memory is sampled."""
        super().__init__(daemon=True)
        self.url, self.program = url, program
        self.changes = []  # (monotonic seconds, what, from, to, reason)
        self.memory = []  # (monotonic seconds, MB)
        self.answers, self.failures = 0, 0
        self.last = {}
        self.state = {}  # the latest answer
        self.events = {}
        self.stopped = threading.Event()

    def run(self):
        while not self.stopped.wait(PERIOD_S):
            now = time.monotonic()
            if self.program is not None and (memory := self.program.memory_mb()) is not None:
                self.memory.append((now, memory))
            try:
                with urllib.request.urlopen(self.url + "/v1/state", timeout=2) as answer:
                    self._look(now, json.load(answer))
                    self.answers += 1
            except (OSError, ValueError, urllib.error.URLError):
                self.failures += 1

    def stop(self):
        self.stopped.set()
        self.join()

    def _look(self, now, state):
        values = {"state": state.get("state"), "source": state.get("source"),
                  "gps": (state.get("gps") or {}).get("judgement")}
        for what, value in values.items():
            if self.last.get(what) != value:
                self.changes.append((now, what, self.last.get(what), value, self._reason(what, state)))
        self.last = values
        self.state = state
        for event in state.get("events") or []:
            happened = {**event, "at": now - (event.get("age_s") or 0.0)}  # monotonic seconds
            self.events.setdefault((state.get("boot"), event.get("id")), happened)

    @staticmethod
    def _reason(what, state):
        """Of a change of state as the service noted it then: what it says of its state later has counted on."""
        noted = [event for event in state.get("events") or [] if what == "state" and event.get("kind") == "state"]
        return max(noted, key=lambda event: event.get("id") or 0)["text"] if noted else state.get("reason") or ""

    def memory_growth(self, after_s=60):
        """Largest over smallest after the first minute, in percent; None when it was not sampled for long enough."""
        later = [mb for t, mb in self.memory if t - self.memory[0][0] > after_s]
        return None if len(later) < 10 else 100 * (max(later) / min(later) - 1)
