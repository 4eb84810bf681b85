"""The figures of nadird's summary at the end of a flight."""
import re

LINE = re.compile(r"(\d+) frames, (\d+) dropped; frame to fix p50 (\d+), p95 (\d+), max (\d+) ms; (\d+) fixes, longest "
                  r"gap (\d+) ms")
NAMES = ("frames", "dropped", "p50_ms", "p95_ms", "max_ms", "fixes", "longest_pause_ms")


def run_summary(log):
    """The figures of the last such line of its log; None when there is none."""
    found = LINE.findall(log)
    return dict(zip(NAMES, map(int, found[-1]))) if found else None
