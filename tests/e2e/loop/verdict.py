"""The figures of a closed loop, its timeline, and their limits."""
import csv

MAX_DEVIATION_M = 50
MEDIAN_DEVIATION_M = 10
MAX_SPACING_S = 0.2
FOLLOWS_SPOOF_M = 100  # a fix this far off follows a 300 m spoofing step
LATENCY_P95_MS = 120
DROPPED_SHARE = 0.1
BY_PICTURES = ("satellite_anchored", "vo_extrapolated")  # they change all the time
SIGMAS_OF_95 = 2.448  # of a circular Gaussian, in one axis' sigma
FRESH_S = 0.1  # a fix is judged where it was given, not where the aircraft has flown to since
MEMORY_GROWTH_PERCENT = 10  # ± 5 %, after the first minute


class Verdict:
    def __init__(self, summary, track_csv, after_s=0.0, service=None):
        """summary: the autopilot's. after_s: from when on the given position is asked for (the denial). service: what nadird
        said at its end (run_summary), None for the stand-in."""
        self.summary, self.service = summary, service
        self.memory_growth_percent = None
        with open(track_csv, newline="", encoding="utf-8") as file:
            self.rows = list(csv.DictReader(file))
        self.after_s = after_s

    def share_given(self):
        """The share of the time after the denial navigated by the given position."""
        later = [row["source"] for row in self.rows if float(row["time_s"]) > self.after_s + 3]
        return sum(source == "gps_input" for source in later) / len(later) if later else 0.0

    def promotion_s(self):
        """From the denial until the autopilot navigated by the given position."""
        for row in self.rows:
            if float(row["time_s"]) >= self.after_s and row["source"] == "gps_input":
                return float(row["time_s"]) - self.after_s
        return None

    def sigmas_off(self):
        """Of each row with a fresh fix: how far that was off, in its own sigmas."""
        fresh = [row for row in self.rows if row["given_error_m"] and float(row["given_age_s"]) <= FRESH_S and float(row["given_accuracy_m"] or 0) > 0]
        return [float(row["given_error_m"]) / float(row["given_accuracy_m"]) for row in fresh]

    def _accuracy(self):
        sigmas = self.sigmas_off()
        if not sigmas:
            return "none was given"
        within = sum(one <= SIGMAS_OF_95 for one in sigmas) / len(sigmas)
        return f"{100 * within:.1f} % within their 95 %, the worst {max(sigmas):.1f} sigmas off"

    def shortfalls(self, everything=True):
        """The violated limits as text. everything: also those that depend on the load of the machine."""
        found = []
        deviation, fix = self.summary["deviation_m"], self.summary["fix_error_m"]
        if deviation["max"] > MAX_DEVIATION_M:
            found.append(f"the true track leaves the plan by {deviation['max']} m, at most {MAX_DEVIATION_M}")
        if deviation["median"] > MEDIAN_DEVIATION_M:
            found.append(f"the median deviation is {deviation['median']} m, at most {MEDIAN_DEVIATION_M}")
        if self.summary["resets_by_gps_input"] > 0:
            found.append(f"the autopilot's filter was reset {self.summary['resets_by_gps_input']} times by GPS_INPUT")
        if fix is None:
            found.append("no fix was given")
        elif fix["max"] > FOLLOWS_SPOOF_M:
            found.append(f"a given fix was {fix['max']} m off, at most {FOLLOWS_SPOOF_M}")
        return found + (self._slow() if everything else [])

    def _slow(self):
        found = []
        if self.summary["gps_input_spacing_max_s"] > MAX_SPACING_S + 0.02:  # the autopilot looks fifty times a second
            found.append(f"GPS_INPUT paused for {self.summary['gps_input_spacing_max_s']:.2f} s, at most "
                         f"{MAX_SPACING_S}")
        if self.service is not None and self.service["p95_ms"] > LATENCY_P95_MS:
            found.append(f"from frame to fix {self.service['p95_ms']} ms (p95), at most {LATENCY_P95_MS}")
        if self.service is not None and self.service["dropped"] > DROPPED_SHARE * self.service["frames"]:
            found.append(f"{self.service['dropped']} of {self.service['frames']} frames were dropped")
        if (self.memory_growth_percent or 0) > MEMORY_GROWTH_PERCENT:
            found.append(f"memory grew by {self.memory_growth_percent:.0f} % after the first minute")
        return found

    def figures(self):
        deviation, fix = self.summary["deviation_m"], self.summary["fix_error_m"]
        promotion = self.promotion_s()
        service = [] if self.service is None else [
            ("frame to fix", "p50 {p50_ms}, p95 {p95_ms}, max {max_ms} ms; {dropped} of {frames} frames dropped; longest "
                               "pause of fixes {longest_pause_ms} ms".format(**self.service))]
        return [
            ("flown", f"{self.summary['duration_s']:.0f} s, laps of {self.summary['plan_m']:.0f} m"),
            ("true track from plan", f"median {deviation['median']:.1f}, p95 {deviation['p95']:.1f}, max "
                                     f"{deviation['max']:.1f} m"),
            ("given fix from truth", "none was given" if fix is None else
             f"median {fix['median']:.1f}, p95 {fix['p95']:.1f}, max {fix['max']:.1f} m over {fix['count']} fixes"),
            ("their own accuracy", self._accuracy()),
            ("flown by given fixes", f"{100 * self.share_given():.1f} % after the first trouble"
                                     + ("" if promotion is None else f", from {promotion:.1f} s after it on")),
            ("GPS_INPUT", ", ".join(f"{n} {word}" for word, n in sorted(self.summary["gps_input"].items())) or "none"),
            ("longest pause", f"{self.summary['gps_input_spacing_max_s']:.2f} s, {self.summary['gps_input_late']} later than "
                              "0.245 s"),
            ("filter resets", ", ".join(f"{r['time_s']:.0f} s by {r['source']} ({r['reason']}, {r['metres']:.0f} m)"
                                        for r in self.summary["resets"]) or "none"),
            *service,
        ]


def timeline(summary, changes, begun):
    """Lines in order of time: the faults, and the service's response. begun: monotonic seconds
    of the autopilot's start."""
    lines = [(event["time_s"], "aircraft", " ".join(f"{value}" for key, value in event.items()
                                                   if key not in ("time_s", "kind") and value != "") or event["kind"])
             for event in summary["events"] if event["kind"] in ("scenario", "source", "reset", "statustext", "late")]
    lines += [(at - begun, "service", f"{what}: {before} -> {now}" + (f" ({reason})" if reason and what == "state" else ""))
              for at, what, before, now, reason in changes
              if before is not None and not (before in BY_PICTURES and now in BY_PICTURES)]
    return [f"{time:8.1f} s  {who:9}{text}" for time, who, text in sorted(lines, key=lambda line: line[0])]
