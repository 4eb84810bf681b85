"""The evidence of a flight under faults: the autopilot's rows, the states polled from the API, and the recordings."""
import dataclasses
import subprocess

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader

FRESH_S = 0.3  # count new fixes only, not the last one repeated
WRONG_M, WRONG_SIGMAS = 50, 3


@dataclasses.dataclass
class Finding:
    fault: str
    expected: str
    found: str
    met: bool


def fresh_fixes(rows):
    return [row for row in rows if int(row["given_fix_type"]) >= 3 and row["given_error_m"] and row["given_accuracy_m"]
            and float(row["given_age_s"]) < FRESH_S]


def wrong_and_sure(rows):
    """Fixes that are far off without stating so."""
    return [row for row in fresh_fixes(rows) if float(row["given_error_m"]) > WRONG_M
            and float(row["given_error_m"]) > WRONG_SIGMAS * float(row["given_accuracy_m"])]


def judged_right(fault, rows):
    """No wrong position is ever labelled good."""
    fixes, wrong = fresh_fixes(rows), wrong_and_sure(rows)
    worst = max((float(row["given_error_m"]) for row in fixes), default=0.0)
    return Finding(fault, f"no fix more than {WRONG_M} m off and beyond {WRONG_SIGMAS} of its sigmas",
                   f"{len(wrong)} of {len(fixes)}; worst {worst:.1f} m off", not wrong and bool(fixes))


def longest_pause_s(rows):
    """The interval between fixes, as the autopilot saw it."""
    return max((float(row["given_age_s"]) for row in rows if row["given_age_s"]), default=float("inf"))


def within(rows, from_s, to_s):
    return [row for row in rows if from_s <= float(row["time_s"]) <= to_s]


class States:
    """changes: what Watch saw; begun: monotonic seconds that count as 0."""

    def __init__(self, changes, begun):
        self.changes = [(at - begun, what, now) for at, what, _, now, _ in changes]

    def during(self, from_s, to_s, what="state"):
        """All that held at some time between, in order."""
        values, before = [], None
        for at, name, now in self.changes:
            if name != what:
                continue
            if at <= from_s:
                before = now
            elif at <= to_s:
                values.append(now)
        return ([before] if before is not None else []) + values

    def first(self, value, after_s, what="state"):
        return next((at for at, name, now in self.changes if name == what and now == value and at >= after_s), None)


def readable(fault, nadir, folder):
    """The recording, checked by `nadir recorder verify` and by the mcap package from PyPI."""
    verified = subprocess.run([str(nadir), "recorder", "verify", str(folder)], capture_output=True, text=True, check=False)
    segments = sorted(folder.glob("*.flight.mcap"))
    records, cut = 0, 0
    for segment in segments:
        with open(segment, "rb") as file:
            try:
                for _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                    records += 1
            except (McapError, EOFError):
                cut += 1  # by a kill, or by a disk that was full
    said = "accepted" if verified.returncode == 0 else verified.stdout.strip()[:160]
    return Finding(fault, "accepted by recorder verify and readable by another reader",
                   f"{said}; {records} records in {len(segments)} segments, {cut} of them cut off",
                   verified.returncode == 0 and records > 0)


def table(findings):
    head = Finding("fault", "expected", "found", True)
    widths = [max(len(getattr(row, field)) for row in [head, *findings]) for field in ("fault", "expected", "found")]
    lines = []
    for row in [head, *findings]:
        cells = [getattr(row, field).ljust(width) for field, width in zip(("fault", "expected", "found"), widths)]
        mark = "" if row is head else "as expected" if row.met else "NOT AS EXPECTED"
        lines.append("  ".join([*cells, mark]).rstrip())
    return "\n".join(lines)
