"""A second sender on the link: from another address and with the autopilot's ids it sends heartbeats, attitudes and positions of
its own, without the key, with another one, with the right one, and on a link that nobody signs. Nothing of it may count, whatever
it is signed with: the fixes stay with the autopilot, GPS stays denied, the map goes on to be matched."""
import threading
import time

from .evidence import Finding, States, judged_right, longest_pause_s, within
from .flight import Flight, Setup
from .link_endpoint import LinkEndpoint, heartbeat, signing_time, telemetry

DENIED_S, MINUTES = 15, 1.5
RATE_HZ = 20
FAR = 1.3  # degrees north of the aircraft
NO_KEY, OTHER_KEY, STOLEN_KEY = (28, 40), (45, 57), (62, 74)
UNSIGNED = (28, 44)


class Intruder(threading.Thread):
    """Speaks from `window`[0] to [1] seconds of the flight, and counts what it is sent."""

    def __init__(self, flight, window, is_rival, **how):
        """is_rival: its frames pass the signing rules, so that only its address gives it away."""
        super().__init__(daemon=True)
        self.flight, self.window, self.is_rival = flight, window, is_rival
        self.endpoint = LinkEndpoint(flight.link_port, **how)
        self.before, self.after = {}, {}
        self.start()

    def run(self):
        while self.flight.elapsed_s() < self.window[0]:
            time.sleep(0.02)
        self.before, begun = dict(self.flight.watch.state), time.monotonic()
        self.endpoint.mav.signing.timestamp = signing_time()  # a holder of the key dates his frames as they are sent
        while self.flight.elapsed_s() < self.window[1]:
            self.endpoint.send(heartbeat(), *telemetry(begun, lat=47.4 + FAR, yaw=-1.0))
            time.sleep(1 / RATE_HZ)
        time.sleep(0.5)
        self.after = dict(self.flight.watch.state)

    def fixes(self):
        return self.endpoint.count("GPS_INPUT")


def fly(args, inputs, run):
    """The findings."""
    (run / "signed").mkdir()
    (run / "unsigned").mkdir()
    key = bytes.fromhex(inputs.key.read_text().strip())
    signed = [("without the key", NO_KEY, False, {}), ("with another key", OTHER_KEY, False, {"key": bytes(range(32))}),
              ("with the stolen key", STOLEN_KEY, True, {"key": key, "link_id": 9})]
    return (_flight(args, inputs, run / "signed", True, signed)
            + _flight(args, inputs, run / "unsigned", False, [("link not signed", UNSIGNED, True, {})]))


def _flight(args, inputs, run, is_signed, intruders):
    minutes = MINUTES if is_signed else MINUTES - 0.5
    setup = Setup(inputs, run, args.nadir, args.nadird, [f"{DENIED_S}:gps-denied"], minutes, signed=is_signed)
    with Flight(setup) as flight:
        flight.start()
        at_work = [(name, Intruder(flight, window, is_rival, **how)) for name, window, is_rival, how in intruders]
        flight.wait()
        for _, intruder in at_work:
            intruder.join()
        summary, _ = flight.finish()
        states = States(flight.watch.changes, flight.begun_flying)
        events = [event for _, event in sorted(flight.watch.events.items())]
        begun = flight.begun_flying
    rows, findings = setup.rows(), []
    for name, intruder in at_work:
        findings += judge(f"second sender, {name}", intruder, rows, states)
        if intruder.is_rival:
            findings += judge_report(f"second sender, {name}", intruder.window, summary, events, begun)
    reported = next((event["text"] for event in summary["events"] if event["kind"] == "statustext" and "NOT SIGNED" in event["text"]), None)
    if not is_signed:
        findings.append(Finding("second sender, link not signed", "operator: the link is not signed", reported or "not reported", reported is not None))
    for _, intruder in at_work:
        intruder.endpoint.close()
    return findings + [judged_right("second sender, " + ("signed" if is_signed else "not signed"), rows)]


def judge(fault, intruder, rows, states):
    window = intruder.window

    def count(state):
        link = state.get("link", {})
        return link.get("rivals", 0) if intruder.is_rival else sum(link.get("rejected_by", {}).values())
    noticed = count(intruder.after) - count(intruder.before)
    pause = longest_pause_s(within(rows, *window))
    judgements = set(states.during(window[0] + 1, window[1], "gps"))
    modes = states.during(*window)
    anchors = intruder.after.get("anchors", {}).get("accepted", 0) - intruder.before.get("anchors", {}).get("accepted", 0)
    return [
        Finding(fault, "its frames are dropped and counted", f"{noticed} of {len(intruder.endpoint.sent)}", noticed > len(intruder.endpoint.sent) / 2),
        Finding(fault, "it is sent no fix", f"{intruder.fixes()} GPS_INPUT", intruder.fixes() == 0),
        Finding(fault, "the autopilot's fixes go on", f"longest pause {pause:.2f} s", pause <= 0.3),
        Finding(fault, "its GPS counts for nothing: denied as before", ", ".join(map(str, judgements)), judgements == {"denied"}),
        Finding(fault, "its attitudes count for nothing: matched to the map as before", f"{anchors} anchors; {' → '.join(dict.fromkeys(map(str, modes)))}",
                anchors > 0 and set(modes) == {"normal"})]


def judge_report(fault, window, summary, events, begun):
    """A frame with a wrong signature is counted alone; a sender that only its address gives away is an alarm."""
    event = next((event for event in events if event.get("kind") == "link" and "another sender" in event["text"]
                  and begun + window[0] - 1 <= event["at"] <= begun + window[1] + 2), None)
    reported = next((item for item in summary["events"] if item["kind"] == "statustext" and "another sender" in item["text"]
                 and window[0] - 1 <= item["time_s"] <= window[1] + 2), None)
    return [Finding(fault, "a critical event", "none" if event is None else event["text"][:80], event is not None and event.get("severity") == "critical"),
            Finding(fault, "operator: another sender claims to be autopilot", "not reported" if reported is None else
                    f"reported {reported['time_s'] - window[0]:.1f} s after", reported is not None)]
