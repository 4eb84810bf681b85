"""The rules of docs/onboard.md, checked against what happened to the aircraft.

Times are the autopilot's: when the operator was notified, when a fix arrived. Rules that a flight did not trigger are
omitted.
"""
import dataclasses
import re

SPOOFED, DENIED, TRUSTED = "Nadir: GPS SPOOFED", "Nadir: GPS denied", "Nadir: GPS trusted"
MAP_LEADS, GPS_LEADS = "Nadir: autopilot now navigating by Nadir", "Nadir: autopilot navigating by GPS"
NO_PICTURES, SEES_AGAIN = "Nadir: no camera frames, dead reckoning", "Nadir: visual position restored"
COLD_START_S, PROMOTED_S, BLACKOUT_S, BLIND_S, UNDISTURBED_S = 30, 3, 0.4, 30, 10
LOOKS_S = 0.15  # nadird looks every 0.05 s, and may be late
LATEST_INTERVALS = 2  # of a camera whose frames come irregularly: docs/onboard.md
FOLLOWS_M = 100
DROPPED_SHARE = 0.1


@dataclasses.dataclass
class Rule:
    name: str
    allowed: str
    found: str
    met: bool


class Happened:
    """Queries about a flight. summary and rows: the autopilot's. changes: what Watch saw."""

    def __init__(self, summary, rows, changes=()):
        self.summary, self.rows, self.changes = summary, rows, changes

    def scenario(self, *actions):
        """When these were done to the aircraft."""
        return [event["time_s"] for event in self.summary["events"]
                if event["kind"] == "scenario" and event["what"].partition("=")[0] in actions]

    def reported(self, text, after_s=0.0):
        """When the operator first received this text after that time; None when never."""
        return next((event["time_s"] for event in self.summary["events"]
                     if event["kind"] == "statustext" and event["text"] == text and event["time_s"] >= after_s), None)

    def first_fix(self):
        return next((float(row["time_s"]) for row in self.rows if int(row["given_fix_type"]) >= 3), None)

    def between(self, from_s, to_s):
        return [row for row in self.rows if from_s <= float(row["time_s"]) <= to_s]

    def end_s(self):
        return float(self.rows[-1]["time_s"])

    def reason(self, pattern):
        """The first number in a matching reason of a state change."""
        return next((float(found.group(1)) for *_, reason in self.changes if (found := re.search(pattern, reason))), None)


def judge(summary, rows, service, changes=(), frame_s=0.0):
    """The rules that this flight triggered, in the order of the table. service: run_summary()'s. frame_s: from frame to frame."""
    flight = Happened(summary, rows, changes)
    rules = [_cold_start(flight)]
    for action, text in (("gps-step", SPOOFED), ("gps-drag", SPOOFED), ("gps-denied", DENIED)):
        rules += [_promoted(flight, action, text, at) for at in flight.scenario(action)]
    for cut, restored in _blackouts(flight):
        rules += _blackout(flight, cut, restored, max(BLACKOUT_S, LATEST_INTERVALS * frame_s))
    rules += [rule for at in flight.scenario("gps-recover") for rule in _recovered(flight, at)]
    return rules + [_not_followed(flight), _healthy(flight), _heartbeats(flight), _dropped(service)]


def _seconds(value):
    return "never" if value is None else f"{value:.2f} s"


def _cold_start(flight):
    first = flight.first_fix()
    return Rule("cold start to the first fix", f"{COLD_START_S} s", _seconds(first),
                first is not None and first <= COLD_START_S)


def _promoted(flight, action, text, at):
    """A drag is slow: it counts from when the operator is notified."""
    reported = flight.reported(text, at)
    since = reported if action == "gps-drag" else at
    lead = None if since is None else flight.reported(MAP_LEADS, at)
    after = None if lead is None else max(0.0, lead - since)
    flown = since is not None and all(row["source"] == "gps_input"
                                      for row in flight.between(since + PROMOTED_S, since + PROMOTED_S + 3))
    what = "denied" if text == DENIED else "spoofed"
    return Rule(f"GPS {what} to navigating by our fix", f"{PROMOTED_S} s", _seconds(after) + ("" if flown else ", not navigating by it"),
                after is not None and after <= PROMOTED_S and flown)


def _blackouts(flight):
    ends = flight.scenario("camera-restore")
    for cut in flight.scenario("camera-cut"):
        yield cut, next((end for end in ends if end > cut), flight.end_s())


def _blackout(flight, cut, restored, allowed_s):
    reported = flight.reported(NO_PICTURES, cut)
    blind = flight.reason(r"no frame for ([\d.]+) s")
    rules = [Rule("camera loss to dead reckoning", f"{allowed_s:.2g} s after the last one",
                  _seconds(blind if reported is not None else None),
                  reported is not None and blind is not None and blind <= allowed_s + LOOKS_S)]
    sigmas = [float(row["given_accuracy_m"]) for row in flight.between(reported or cut, restored) if row["given_accuracy_m"]]
    shrinks = max((a - b for a, b in zip(sigmas, sigmas[1:])), default=0.0)
    grown = f"{sigmas[0]:.1f} m to {sigmas[-1]:.1f} m" if sigmas else "none reported"
    rules.append(Rule("σ while blind", "never shrinks", grown + (f", shrinks by {shrinks:.2f} m" if shrinks > 0.011 else ""),
                      bool(sigmas) and shrinks <= 0.011))
    if restored - cut > BLIND_S + 2:
        silent = next((float(row["time_s"]) for row in flight.between(cut, restored) if int(row["given_fix_type"]) < 3), None)
        rules.append(Rule("blind for too long: no fix", f"{BLIND_S} s", _seconds(None if silent is None else silent - cut),
                          silent is not None and silent - cut <= BLIND_S + 1.5))
    if restored < flight.end_s() - 5:
        again = next((at for text in (SEES_AGAIN, "Nadir: position found again")
                      if (at := flight.reported(text, restored)) is not None), None)
        rules.append(Rule("visual position restored", "seen", _seconds(None if again is None else again - restored),
                          again is not None))
    return rules


def _recovered(flight, at):
    trusted, leads = flight.reported(TRUSTED, at), flight.reported(GPS_LEADS, at)
    after = None if trusted is None else trusted - at
    yield Rule("GPS recovery to trusted", f"not before {UNDISTURBED_S} s, and in agreement with frames", _seconds(after),
               (after is not None and after >= UNDISTURBED_S - LOOKS_S)
               or (after is None and flight.end_s() - at < 2 * UNDISTURBED_S))
    if trusted is not None:
        yield Rule("… and used for navigation again", "then", _seconds(None if leads is None else leads - at), leads is not None)


def _not_followed(flight):
    error = flight.summary["fix_error_m"]
    return Rule("no fix follows spoofed GPS", f"{FOLLOWS_M} m off at most", "no fix" if error is None else f"{error['max']:.1f} m",
                error is not None and error["max"] <= FOLLOWS_M)


def _healthy(flight):
    bad = flight.summary["gps_input"].get("unhealthy", 0)
    return Rule("our GPS as the autopilot sees it", "healthy (GPS_INPUT in less than 245 ms)",
                f"longest pause {flight.summary['gps_input_spacing_max_s']:.2f} s"
                + (f", {bad} rejected as unhealthy" if bad else ""), bad == 0)


def _heartbeats(flight):
    rate = flight.summary["received"].get("HEARTBEAT", 0) / max(flight.summary["duration_s"], 1e-9)
    return Rule("status to the ground station", "1 to 2 a second", f"{rate:.2f} a second", 0.9 <= rate <= 2)


def _dropped(service):
    share = service["dropped"] / max(service["frames"], 1)
    return Rule("frames dropped", f"{100 * DROPPED_SHARE:.0f} %", f"{100 * share:.1f} % of {service['frames']}",
                share <= DROPPED_SHARE)


def lines_of(rules):
    """The rules as a table of text."""
    widths = [max(len(getattr(rule, field)) for rule in rules) for field in ("name", "allowed", "found")]
    head = ("rule", "allowed", "found")
    widths = [max(width, len(word)) for width, word in zip(widths, head)]
    rows = [head] + [(rule.name, rule.allowed, rule.found) for rule in rules]
    marks = [""] + ["met" if rule.met else "NOT MET" for rule in rules]
    return ["  ".join([*(cell.ljust(width) for cell, width in zip(row, widths)), mark]).rstrip()
            for row, mark in zip(rows, marks)]
