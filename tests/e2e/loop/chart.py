"""σ and errors over a flight, with the injected faults, as SVG."""
import html
import math

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 1200, 330, 56, 12, 40, 26
BANDS = {"gps-step": "spoofed", "gps-drag": "spoofed", "gps-denied": "spoofed", "camera-cut": "blind", "link-cut": "blind"}
ENDS = {"gps-recover": "spoofed", "camera-restore": "blind", "link-restore": "blind"}
WORDS = {"gps-step": "GPS spoofed", "gps-drag": "GPS dragged off", "gps-denied": "GPS denied", "camera-cut": "no frames",
         "link-cut": "no link"}
CURVES = (("given_accuracy_m", "sigma"), ("given_error_m", "error"), ("deviation_m", "deviation"))


def frame(rows):
    """What the page needs to map a time to a position in the chart."""
    return {"left": LEFT, "right": WIDTH - RIGHT, "end_s": float(rows[-1]["time_s"])}


def largest(rows):
    values = [float(row[name]) for row in rows for name, _ in CURVES if row[name] != ""]
    return max(8.0, 4 * math.ceil(max(values, default=0) / 4))


def svg(rows, events):
    end_s, top_m = float(rows[-1]["time_s"]), largest(rows)

    def x(time_s):
        return LEFT + (WIDTH - LEFT - RIGHT) * time_s / end_s

    def y(metres):
        return TOP + (HEIGHT - TOP - BOTTOM) * (1 - min(metres, top_m) / top_m)

    parts = [*_bands(events, x, end_s), *_axes(x, y, end_s, top_m)]
    for name, kind in CURVES:
        parts.append(f'<path class="curve {kind}" d="{_steps(rows, name, x, y)}"/>')
    parts.append(f'<line id="cursor" class="cursor" y1="{TOP}" y2="{HEIGHT - BOTTOM}" x1="-9" x2="-9"/>')
    return f'<svg id="plot" viewBox="0 0 {WIDTH} {HEIGHT}">{"".join(parts)}</svg>'


def _steps(rows, name, x, y):
    steps, pen_up = [], True
    for row in rows[::2]:
        if row[name] == "":
            pen_up = True
            continue
        steps.append(f"{'M' if pen_up else 'L'}{x(float(row['time_s'])):.1f} {y(float(row[name])):.1f}")
        pen_up = False
    return "".join(steps)


def _bands(events, x, end_s):
    done = [(event["time_s"], event["what"].partition("=")[0]) for event in events if event["kind"] == "scenario"]
    for at, action in done:
        if action not in BANDS:
            continue
        kind = BANDS[action]
        until = next((t for t, other in done if t > at and ENDS.get(other) == kind), end_s)
        row = 0 if kind == "spoofed" else 1
        yield (f'<rect class="band {kind}" x="{x(at):.1f}" width="{x(until) - x(at):.1f}" y="{TOP - 2}" '
               f'height="{HEIGHT - TOP - BOTTOM + 2}"/>'
               f'<text class="band {kind}" x="{x(at) + 3:.1f}" y="{14 + 15 * row}">{html.escape(WORDS[action])}</text>')


def _axes(x, y, end_s, top_m):
    for i in range(5):
        metres = top_m * i / 4
        yield (f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y(metres):.1f}" y2="{y(metres):.1f}"/>'
               f'<text x="{LEFT - 6}" y="{y(metres) + 4:.1f}" text-anchor="end">{metres:g} m</text>')
    step = next(s for s in (10, 20, 30, 60, 120, 300, 600) if end_s / s <= 12 or s == 600)
    for time_s in range(0, int(end_s) + 1, step):
        yield f'<text x="{x(time_s):.1f}" y="{HEIGHT - 8}" text-anchor="middle">{time_s} s</text>'
