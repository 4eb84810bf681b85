"""The figures of a flight of an autopilot's own simulator, its timeline, and their limits."""
from .evidence import WRONG_M, WRONG_SIGMAS

MAX_FILTER_ERROR_M, MAX_FIX_ERROR_M = 50, 50
MAX_DEVIATION_M = 150  # at its sharp corners ArduPlane overshoots by 105 m, however accurate its position
SETTLED_S = 3  # after the fault


def spread(pairs):
    """"median, p95, max" of (time, metres)."""
    values = sorted(value for _, value in pairs)
    if not values:
        return "none"
    return (f"median {values[len(values) // 2]:.1f}, p95 {values[int(len(values) * 0.95)]:.1f}, max {values[-1]:.1f} m "
            f"({len(values)})")


class SitlVerdict:
    def __init__(self, flight, service):
        self.flight, self.track, self.service = flight, flight.track, service
        end_s = self.track.now_s
        trouble_s = flight.done[0][0] if flight.done else end_s
        self.parts = {"before": (flight.on_circuit_s, trouble_s), "after": (trouble_s + SETTLED_S, end_s)}

    def figures(self):
        yield "autopilot", self.flight.vehicle.version(self.flight)
        if self.flight.changed:
            what, *noted_s = self.flight.changed
            yield "changed before take-off", "{}: noted after {}, set back after {}".format(
                what, *("never" if after_s is None else f"{after_s:.1f} s" for after_s in noted_s))
        yield "its clock", f"{self.flight.pace:.3f} s in a second"
        for name, (from_s, to_s) in self.parts.items():
            if to_s <= from_s:
                continue
            track = self.track
            yield f"{name} the trouble", f"{to_s - from_s:.0f} s"
            yield "  true track from legs", spread(track.deviations(from_s, to_s))
            yield "  filter from truth", spread(track.errors(track.estimated, from_s, to_s))
            yield "  given fix from truth", spread(track.fix_errors(track.given, from_s, to_s))
            yield "  wrong and sure", "{} of {} fixes beyond {} m and {} of their sigmas".format(
                *track.wrong_and_sure(from_s, to_s), WRONG_M, WRONG_SIGMAS)
            yield "  own receiver from truth", spread(track.fix_errors(track.own, from_s, to_s))
            if (off := track.attitude_errors(from_s, to_s)) is not None:
                yield "  attitude from truth", ", ".join(f"{name} {mean:+.1f} ± {spread:.1f}°" for name, (mean, spread) in zip(
                    ("roll", "pitch", "heading"), off))
            yield "  filter's resets", ", ".join(f"{metres:.0f} m at {self.clock(at)}" for at, metres in
                                                 track.resets(from_s - SETTLED_S, to_s)) or "none"
            flags = track.filter_flags(from_s, to_s)
            yield "  filter says", "nothing" if flags is None else (
                f"position known {100 * flags[0]:.0f} %, GPS glitch {100 * flags[1]:.0f} % of the time, position variance "
                f"at most {flags[2]:.2f}")
        yield "frame to fix", "p50 {p50_ms}, p95 {p95_ms}, max {max_ms} ms; {dropped} of {frames} frames dropped".format(
            **self.service)

    def shortfalls(self):
        from_s, to_s = self.parts["after" if self.flight.done else "before"]
        track, found = self.track, []
        if self.flight.changed and None in self.flight.changed:
            found.append(f"nadird did not note {self.flight.changed[0]}, or that it was set back")
        for what, pairs, allowed in (
                ("the autopilot's position was off by", track.errors(track.estimated, from_s, to_s), MAX_FILTER_ERROR_M),
                ("a given fix was off by", track.fix_errors(track.given, from_s, to_s), MAX_FIX_ERROR_M),
                ("the true track left the legs by", track.deviations(from_s, to_s), MAX_DEVIATION_M)):
            if not pairs:
                found.append(f"{what} an unknown distance")
            elif (worst := max(value for _, value in pairs)) > allowed:
                found.append(f"{what} {worst:.0f} m, at most {allowed}")
        if (wrong := track.wrong_and_sure(from_s, to_s)[0]) > 0:
            found.append(f"{wrong} fixes were beyond {WRONG_M} m and {WRONG_SIGMAS} of their sigmas")
        return found

    def timeline(self):
        """Lines in order of time."""
        boot, flight = self.track.boot_s, self.flight
        lines = [(boot(at), flight.vehicle.name, text) for at, _, text in flight.station.texts if boot(at) is not None]
        lines += [(at, "done to it", what) for at, what in flight.done]
        lines += [(flight.on_circuit_s, "flight", "on the circuit, at its height")]
        lines += [(boot(at), "service", f"{what}: {before} -> {now} {reason if what == 'state' else ''}".rstrip())
                  for at, what, before, now, reason in flight.watch.changes if before is not None and what != "source"]
        return [f"{self.clock(at)}  {who:11}{text}" for at, who, text in sorted(lines)]

    def clock(self, boot_s):
        return f"{boot_s - self.flight.on_circuit_s:8.1f} s"
