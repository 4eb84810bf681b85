"""Which flight proves which rule of docs/onboard.md in real time, and what must be seen there. A row of the page's tables
without a proof here fails closed_loop_test.py."""
import dataclasses

from .rules import Happened

SETTLES_S = 0.5  # a look every 0.05 s, a STATUSTEXT on its way, an autopilot that reads it fifty times a second
FIRST_FIX_S, FAILSAFE_S, BLIND_S, LINK_LOST_S = 30, 3, 30, 5

# Rows that no flight here triggers.
UNIT_TESTS_ALONE = {
    "sigma_too_large": "blind, σ grows to some 200 m before 30 s are over",
    "localizer_lost": "the same: by then the state says so",
    "started": "the reason until another one is known",
    "link_without_signing": "these flights are signed",
    "matches to the map end with an exception": "no frame makes the matcher throw",
    "matcher_failing": "the same",
    "no protection level for longer than the time to alert (3 s)": "no flight here sees so much that contradicts its place",
    "integrity_lost": "the same",
    "vision_leads_unconfirmed": "the autopilots of these flights are as they were provisioned",
    "armed, and no position for 15 s, neither ours nor that of a trusted GPS": "no flight here is lost for so long; "
                                                                               "SignedStation is, in the tests of flight",
}


@dataclasses.dataclass
class Proof:
    row: str  # first column of a table of docs/onboard.md
    scene: str
    asked: str  # in words
    within_s: float  # … and so quickly; None: whenever
    look: object  # f(Seen) -> seconds, or None when it was not seen
    needs: str = None  # the fault injection that must have been possible


@dataclasses.dataclass
class Seen:
    """One flight: the autopilot's side (Happened), the API's events (seconds of flight, kind, text), and when each fault
    was injected."""
    happened: Happened
    events: list
    done: dict

    def after(self, start, text):
        """From `start` until the operator was notified; None when never, or when nothing started it."""
        at = None if start is None else self.happened.reported(text, start - 0.05)
        return None if at is None else max(0.0, at - start)

    def act(self, action, number=0):
        times = self.happened.scenario(action)
        return times[number] if len(times) > number else None

    def event(self, start, text, kind="state"):
        """The same for an event of the API."""
        if start is None:
            return None
        return next((at - start for at, what, words in self.events if what == kind and text in words and at >= start - 0.05),
                    None)


def _between(action, first, second):
    """From one text to another, both after what was done."""
    def look(seen):
        since = seen.act(action)
        return None if since is None else seen.after(seen.happened.reported(first, since), second)
    return look


def _after(action, text, number=0):
    return lambda seen: seen.after(seen.act(action, number), text)


def _after_hand(name, text):
    return lambda seen: seen.after(seen.done.get(name), text)


def _grows(seen):
    """σ while blind, from the first such row to the last; the result is the seconds examined."""
    begin = seen.happened.reported("Nadir: no camera frames, dead reckoning", seen.act("camera-cut", 1) or 0)
    end = None if begin is None else seen.happened.reported("Nadir: NO FIX, blind for too long", begin)
    if end is None:
        return None
    reported = [(float(row["time_s"]), float(row["given_accuracy_m"])) for row in seen.happened.between(begin + 0.5, end - 0.5)
            if row["given_accuracy_m"]]
    never_shrinks = all(later[1] >= one[1] - 0.011 for one, later in zip(reported, reported[1:]))
    grown = reported and reported[-1][1] - reported[0][1] >= 0.95 * 5 * (reported[-1][0] - reported[0][0])
    return end - begin if never_shrinks and grown else None


def _follows(seen):
    """The fix while blind stays within three of the stated sigmas, and turns with the aircraft."""
    begin = seen.act("camera-cut", 1)
    rows = [] if begin is None else [row for row in seen.happened.between(begin, begin + BLIND_S)
                                     if int(row["given_fix_type"]) >= 3 and row["given_error_m"]]
    good = [row for row in rows if float(row["given_error_m"]) <= 3 * float(row["given_accuracy_m"])]
    return float(rows[-1]["time_s"]) - begin if rows and len(good) == len(rows) else None


def _left_out(seen):
    """… and does not disturb any fix."""
    at = seen.done.get("backlog")
    said = seen.event(at, "stale frames", "camera")
    rows = [] if at is None else seen.happened.between(at, at + 8)
    astray = [row for row in rows if int(row["given_fix_type"]) >= 3 and row["given_error_m"]
              and float(row["given_error_m"]) > max(20.0, 3 * float(row["given_accuracy_m"]))]
    return said if rows and not astray else None


def _never_accused(seen):
    """Not even while the filter reports a glitch after half a minute of our dead reckoning."""
    given_up = seen.happened.reported("Nadir: NO FIX, blind for too long", seen.act("camera-cut", 1) or 0)
    accused = seen.happened.reported("Nadir: GPS SPOOFED")
    return seen.happened.end_s() - given_up if given_up is not None and accused is None else None


def _reported_no_position(seen):
    reported = seen.happened.reported("Nadir: map package rejected, no position")
    return reported if reported is not None and seen.happened.first_fix() is None else None


def _first_waits_for_nothing(seen):
    """From failsafe to normal with the first anchor: the event that ends failsafe is that of the anchor itself."""
    lost = seen.happened.reported("Nadir: FAILSAFE, no position")
    return None if lost is None else seen.after(seen.act("camera-restore"), "Nadir: position found")


def _steady_first(least_s, start, text):
    """Not before so long after what begins it."""
    def look(seen):
        after = seen.after(start(seen), text)
        return after if after is not None and after >= least_s else None
    return look


BACK_S = 8  # matched and stable: matching takes its time
LONG_DARK_S = 25  # blind for half a minute, the match contradicts the prediction: votes from different ground must agree
PROOFS = [
    Proof("an unusable frame", "camera", "notified after a black frame", SETTLES_S + 0.3,
          _after_hand("black", "Nadir: camera blind, dead reckoning")),
    Proof("frame_unfit", "camera", "notified after a repeated frame", SETTLES_S + 0.3,
          _after_hand("again", "Nadir: camera blind, dead reckoning")),
    Proof("frames, but no estimate", "camera", "notified while the localizer is stopped", 1 + SETTLES_S + 0.4,
          _after_hand("held", "Nadir: estimates late, dead reckoning"), needs="held"),
    Proof("localizer_late", "camera", "the same, in the events", 1 + SETTLES_S + 0.4,
          lambda seen: seen.event(seen.done.get("held"), "no estimate for"), needs="held"),
    Proof("camera_silent", "camera", "delayed frames are dropped", 1, _left_out),
    Proof("no frame", "camera", "notified after the last frame", 0.4 + 0.34 + 0.25 + SETTLES_S,
          _after("camera-cut", "Nadir: no camera frames, dead reckoning", 1)),
    Proof("σ while blind", "camera", "never shrinks, grows by 5 m/s", None, _grows),
    Proof("the fix while blind", "camera", "within three of its sigmas for 30 s", None, _follows),
    Proof("blind for longer than 30 s, or σ beyond 500 m", "camera", "notified after the camera failed", BLIND_S + 2,
          _after("camera-cut", "Nadir: NO FIX, blind for too long", 1)),
    Proof("blind_too_long", "camera", "and the fix is gone", BLIND_S + 2, lambda seen: next(
        (float(row["time_s"]) - seen.act("camera-cut", 1)
         for row in seen.happened.between((seen.act("camera-cut", 1) or 0) + 20, seen.happened.end_s())
         if int(row["given_fix_type"]) < 3), None)),
    Proof("position_not_usable", "camera", "notified within 3 s of the level's 100 m, some 4 s blind", 4.5 + 3 + SETTLES_S,
          _after("camera-cut", "Nadir: POSITION NOT USABLE", 1)),
    Proof("position_usable_again", "camera", "matched, then 3 s", LONG_DARK_S + 3,
          _steady_first(3, lambda seen: seen.act("camera-restore", 1), "Nadir: position usable again")),
    Proof("back from `degraded`", "camera", "not before 1 s of frames", BACK_S,
          _steady_first(1, lambda seen: seen.act("camera-restore"), "Nadir: visual position restored")),
    Proof("vision_back", "camera", "after a black frame", BACK_S, _after_hand("black", "Nadir: visual position restored")),
    Proof("back from `no_fix`", "camera", "an anchor, then 1 s", LONG_DARK_S,
          _steady_first(1, lambda seen: seen.act("camera-restore", 1), "Nadir: position found again")),
    Proof("first_anchor", "camera", "cold start", FIRST_FIX_S, lambda seen: seen.happened.first_fix()),
    Proof("link_authentic", "camera", "notified", FIRST_FIX_S, lambda seen: seen.happened.reported("Nadir: searching for the position")),
    Proof("denied", "failsafe", "notified after GPS was lost", 1.5 + SETTLES_S, _after("gps-denied", "Nadir: GPS denied")),
    Proof("gps_denied", "failsafe", "the same, in the events", 1.5 + SETTLES_S,
          lambda seen: seen.event(seen.act("gps-denied"), "GPS is denied")),
    Proof("GPS denied or spoofed, and we have a position", "failsafe", "notified after GPS was lost", 3,
          _after("gps-denied", "Nadir: autopilot now navigating by Nadir")),
    Proof("vision_leads", "failsafe", "after the verdict", SETTLES_S, _between("gps-denied", "Nadir: GPS denied", "Nadir: autopilot now navigating by Nadir")),
    Proof("no position for longer than 3 s", "failsafe", "notified after our fix was lost", FAILSAFE_S + SETTLES_S,
          _between("camera-cut", "Nadir: NO FIX, blind for too long", "Nadir: FAILSAFE, no position")),
    Proof("no_position", "failsafe", "not before 3 s", FAILSAFE_S + SETTLES_S, _steady_first(
        FAILSAFE_S - 0.2, lambda seen: seen.happened.reported("Nadir: NO FIX, blind for too long"),
        "Nadir: FAILSAFE, no position")),
    Proof("back from `failsafe`", "failsafe", "an anchor, then 2 s", LONG_DARK_S,
          _steady_first(2, lambda seen: seen.act("camera-restore"), "Nadir: position found again")),
    Proof("anchored_again", "failsafe", "the same, in the events", LONG_DARK_S,
          lambda seen: seen.event(seen.act("camera-restore"), "matched to the map again")),
    Proof("nothing from the autopilot for 5 s", "failsafe", "in the events, after the link was cut",
          LINK_LOST_S + 1 + SETTLES_S, lambda seen: seen.event(seen.act("link-cut"), "no messages from the autopilot")),
    Proof("link_lost", "failsafe", "not before 5 s", LINK_LOST_S + 1 + SETTLES_S, lambda seen: next(
        (after for after in [seen.event(seen.act("link-cut"), "no messages from the autopilot")]
         if after is not None and after >= LINK_LOST_S - 1.2), None)),
    Proof("link_back", "failsafe", "notified", 1 + SETTLES_S + 0.5, _after("link-restore", "Nadir: autopilot link restored")),
    Proof("spoofed", "spoofing", "notified after a step of 300 m", 3, _after("gps-step", "Nadir: GPS SPOOFED")),
    Proof("spoofed", "camera", "never while GPS is good", None,
          _never_accused),
    Proof("gps_spoofed", "spoofing", "dragged off by 4 m/s", 25, _after("gps-drag", "Nadir: GPS SPOOFED")),
    Proof("trusted again", "spoofing", "10 s undisturbed and in agreement", 16,
          _steady_first(9.8, lambda seen: seen.act("gps-recover"), "Nadir: GPS trusted")),
    Proof("gps_leads", "spoofing", "then", SETTLES_S,
          _between("gps-recover", "Nadir: GPS trusted", "Nadir: autopilot navigating by GPS")),
    Proof("gps_trusted", "silence", "denied only, without frames: 60 s", 63,
          _steady_first(59.8, lambda seen: seen.act("gps-recover"), "Nadir: GPS trusted")),
    Proof("gps_position", "silence", "ends failsafe", SETTLES_S,
          _between("gps-recover", "Nadir: GPS trusted", "Nadir: failsafe over, GPS has a position")),
    Proof("restored", "restart", "notified after the kill", 5, _after_hand("killed", "Nadir: restarted, dead reckoning")),
    Proof("package_verified", "restart", "verified again, in the events", 5,
          lambda seen: seen.event(seen.done.get("killed"), "the package is signed and complete")),
    Proof("back from `failsafe`", "first", "the first position is used immediately", BACK_S, _first_waits_for_nothing),
    Proof("package_refused", "refused", "notified, and never a fix", 10, _reported_no_position),
    Proof("link_unsigned", "unsigned_autopilot", "in the events", 10,
          lambda seen: seen.event(0.0, "without a valid signature")),
]

