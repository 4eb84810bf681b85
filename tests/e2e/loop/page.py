"""The report of a closed loop: one HTML file with the map, accuracy over time, the rules, and the events."""
import base64
import html
import json
import pathlib
import subprocess
import sys
import tempfile

from . import chart
from .ground_map import GroundMap

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "support"))
from simulated_autopilot.geo import LocalPlane
from simulated_autopilot.plan import Plan

STYLE = HERE.parents[2] / "libgeo" / "replay" / "report" / "page.css"
SHOWN = ("scenario", "source", "reset", "statustext")
PICTURE_PX = 1000
TURN_RADIUS_M = 130.0  # the simulated autopilot's


def picture(raster, folder):
    """(JPEG of the world in degrees, (west, south, east, north))"""
    warped, small = folder / "warped.tif", folder / "small.jpg"
    quiet = {"check": True, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.run(["gdalwarp", "-q", "-t_srs", "EPSG:4326", "-r", "average", "-ts", str(PICTURE_PX), "0", str(raster),
                    str(warped)], **quiet)
    subprocess.run(["gdal_translate", "-q", "-of", "JPEG", "-co", "QUALITY=72", "-b", "1", "-b", "2", "-b", "3", str(warped),
                    str(small)], **quiet)
    info = json.loads(subprocess.run(["gdalinfo", "-json", str(warped)], check=True, capture_output=True, text=True).stdout)
    (west, north), (east, south) = info["cornerCoordinates"]["upperLeft"], info["cornerCoordinates"]["lowerRight"]
    return small.read_bytes(), (west, south, east, north)


def places(rows, whose):
    """(seconds, lat, lon) of each fix; None where there was none."""
    for row in rows:
        lat = row[f"{whose}lat_deg"]
        yield (float(row["time_s"]), float(lat), float(row[f"{whose}lon_deg"])) if lat else None


def planned(inputs):
    """The circuit with its rounded corners, as the autopilot flies it."""
    rows = inputs.waypoints.read_text(encoding="utf-8").splitlines()[1:]
    corners = [tuple(map(float, row.split(","))) for row in rows]
    local = LocalPlane(*corners[0])
    plan = Plan([local.to_plane(*corner) for corner in corners], TURN_RADIUS_M)
    return [(0.0, *local.to_degrees(*point)) for point in plan.points]


def tiles(verdict, rules):
    deviation, fix = verdict.summary["deviation_m"], verdict.summary["fix_error_m"]
    met = sum(rule.met for rule in rules)
    rows = [(f"{met}<small>of {len(rules)}</small>", "rules met", met == len(rules)),
            (f"{deviation['max']:.0f}<small>m</small>", f"largest deviation from the plan, median {deviation['median']:.1f} m", None),
            (f"{fix['max']:.0f}<small>m</small>" if fix else "none", "largest error of our fixes", None),
            (str(verdict.summary["resets_by_gps_input"]), "filter resets caused by our fixes",
             verdict.summary["resets_by_gps_input"] == 0)]
    if verdict.service is not None:
        rows.append((f"{verdict.service['p50_ms']}<small>ms</small>",
                     f"from frame to fix, p95 {verdict.service['p95_ms']} ms", None))
    word = {True: " good", False: " bad", None: ""}
    return "".join(f'<div class="tile{word[good]}"><b>{number}</b><span>{text}</span></div>' for number, text, good in rows)


def table(rules):
    cells = "".join(f'<tr class="{"met" if rule.met else "missed"}"><td>{html.escape(rule.name)}<td>{html.escape(rule.allowed)}'
                    f'<td>{html.escape(rule.found)}<td>{"met" if rule.met else "not met"}' for rule in rules)
    return f"<table><thead><tr><th>rule<th>allowed<th>found<th></tr></thead><tbody>{cells}</tbody></table>"


DONE = {"gps-denied": "GPS is denied", "gps-step": "GPS is spoofed: offset by {} m", "gps-drag": "GPS is dragged off: {} m/s",
        "gps-recover": "GPS is good again", "link-cut": "the link is cut", "link-restore": "the link is back",
        "clock-step": "the autopilot's clock jumps by {} s", "camera-cut": "the camera goes dark",
        "camera-restore": "the camera is restored", "reboot": "the autopilot restarts"}
FLOWN_BY = {"own": "navigates by its own GPS", "gps_input": "navigates by our fixes", "none": "navigates without a position"}


def event_text(event):
    if event["kind"] == "scenario":
        action, _, value = event["what"].partition("=")
        return DONE[action].format(value.partition("@")[0])
    if event["kind"] == "source":
        return FLOWN_BY[event["now"]]
    if event["kind"] == "reset":
        return f"the filter is reset by {FLOWN_BY[event['source']].removeprefix('navigates by ')}: {event['metres']:.0f} m"
    return event["text"]


def events(summary):
    return "".join(f'<li class="{event["kind"]}" data-s="{event["time_s"]}"><b>{event["time_s"]:.1f} s</b> '
                   f"{html.escape(str(event_text(event)))}" for event in summary["events"] if event["kind"] in SHOWN)


def write_page(path, inputs, verdict, rules):
    with tempfile.TemporaryDirectory(prefix="nadir-page.") as folder:
        jpeg, box = picture(inputs.world / "ground.tif", pathlib.Path(folder))
    ground = GroundMap(box)
    rows = verdict.rows
    tracks = "".join((ground.line("plan", planned(inputs), closed=True), ground.line("own", places(rows, "own_")),
                      ground.line("given", places(rows, "given_")), ground.line("true", places(rows, ""))))
    moments = [[round(float(row["time_s"]), 1), *(round(n, 1) for n in ground.point(float(row["lat_deg"]),
                                                                                  float(row["lon_deg"])))]
               for row in rows[::2]]
    text = (HERE / "page.html").read_text(encoding="utf-8")
    parts = {"style": STYLE.read_text(encoding="utf-8") + (HERE / "page.css").read_text(encoding="utf-8"),
             "script": (HERE / "page.js").read_text(encoding="utf-8"), "tiles": tiles(verdict, rules),
             "picture": base64.b64encode(jpeg).decode("ascii"), "size": f"{ground.width:.0f} {ground.height:.0f}",
             "width": f"{ground.width:.1f}", "height": f"{ground.height:.1f}", "tracks": tracks,
             "chart": chart.svg(rows, verdict.summary["events"]), "rules": table(rules), "events": events(verdict.summary),
             "minutes": f"{verdict.summary['duration_s'] / 60:.1f}", "moments": json.dumps(moments),
             "plot": json.dumps(chart.frame(rows))}
    for name, part in parts.items():
        text = text.replace("{{" + name + "}}", part)
    pathlib.Path(path).write_text(text, encoding="utf-8")
