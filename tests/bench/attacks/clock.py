"""No attacker but what acts like one: clocks that are wrong, disks that are full, files that are torn, ports that are taken."""
import contextlib
import json
import os
import pathlib
import re
import shutil
import socket
import subprocess
import time

from .aircraft import YEAR, Aircraft
from .registry import NotRun, attack
from .shared import day

from loop.hands import HostClock  # noqa: E402  (shared.py has put its folder on the path)
from loop.small_disk import SmallDisk  # noqa: E402

DAY = 86400


def clock(scene):
    made = HostClock(scene.folder)
    if not made.works:
        raise NotRun("no C compiler for another clock")
    return made


@contextlib.contextmanager
def small_disk(scene, megabytes=1):
    with SmallDisk(scene.folder / "disk", megabytes) as disk:
        if disk.folder is None:
            raise NotRun("this user may not mount a tmpfs")
        yield disk.folder


def fill(folder):
    """The file that takes all the room."""
    ballast = folder / "ballast"
    with open(ballast, "wb", buffering=0) as file:
        for size in (65536, 4096, 1):
            with contextlib.suppress(OSError):
                while True:
                    file.write(bytes(size))
    return ballast


def flies_without(scene, aircraft, part, repair):
    """nadird has its package although a part fails (its name may go on: "recorder's disk"); logs it once; and logs that it
    works again after repair()."""
    logged = lambda words: re.findall(rf"{part}[^:\n]*: {words}", aircraft.service.text())
    aircraft.has_package()
    aircraft.connected()
    scene.wait_for(lambda: logged("failed"), 10, f"the log does not say that the {part} failed: {aircraft.service.text()[-300:]}")
    repair()
    scene.wait_for(lambda: logged("works again"), 40, f"the {part} does not come back: {aircraft.service.text()[-200:]}")
    scene.holds(len(logged("failed")) == 1, f"logged {len(logged('failed'))} times")
    aircraft.flies_on(time.monotonic() - 1)
    return f"flies without, logged once; {logged('works again')[0]}"


@attack("H1", seconds=60)
def state_disk_full(scene):
    """The disk of the state folder is full at the start."""
    with small_disk(scene) as disk:
        ballast = fill(disk)
        scene.attacked(shutil.disk_usage(disk).free == 0, "it is not full")
        with Aircraft(scene, state=disk / "state", autopilot=True) as aircraft:
            return flies_without(scene, aircraft, "state directory", ballast.unlink)


@attack("H1", seconds=60)
def state_disk_read_only(scene):
    """The disk of the state folder has become read-only."""
    with small_disk(scene) as disk:
        (disk / "state").mkdir()
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
        with Aircraft(scene, state=disk / "state", autopilot=True) as aircraft:
            return flies_without(scene, aircraft, "state directory", lambda: subprocess.run(["mount", "-o", "remount,rw", disk], check=True))


@attack("H1", seconds=60)
def port_of_the_api_taken(scene):
    """Another program holds the API's port."""
    aircraft = Aircraft(scene, autopilot=True)
    with socket.socket() as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", aircraft.api_port))
        other.listen()
        with aircraft:
            scene.wait_for(lambda: aircraft.autopilot.count("GPS_INPUT") > 5, 15, f"it sends nothing: {aircraft.service.text()[-200:]}")
            scene.wait_for(lambda: "API: failed" in aircraft.service.text(), 5, "the log does not say so")
            other.close()
            scene.wait_for(lambda: "API: works again" in aircraft.service.text(), 40, "the API does not come back")
            aircraft.has_package()
            aircraft.flies_on(time.monotonic() - 1)
            return "sends to the autopilot without; API: works again"


@attack("H1", seconds=60)
def signing_time_torn(scene):
    """signing-time is cut off after five bytes."""
    state = scene.folder / "state"
    state.mkdir()
    (state / "signing-time").write_text("12345")
    with Aircraft(scene, state=state, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        scene.wait_for(lambda: "signing time: works again" in aircraft.service.text(), 20, f"not reported: {aircraft.service.text()[-200:]}")
        aircraft.flies_on(time.monotonic() - 1)
        kept = (state / "signing-time").read_text().split()
        scene.holds(kept and kept[0].isdigit() and len(kept[0]) > 8, f"the file holds {kept}")
        return "reported, written anew, the link is up"


@attack("H1", seconds=60)
def recorders_disk_full(scene):
    """The recorder's and the candidate tiles' disk is full."""
    with small_disk(scene) as disk:
        ballast = fill(disk)
        with Aircraft(scene, "--record", disk / "record", "--candidates", disk / "tiles", "--tile-key", scene.shared.keys / "tile.key.pem",
                      autopilot=True) as aircraft:
            answer = flies_without(scene, aircraft, "recorder", ballast.unlink)
            scene.wait_for(lambda: "candidate tiles: works again" in aircraft.service.text(), 40, "candidate tiles do not come back")
            return answer


@attack("H1", seconds=60)
def store_of_candidate_tiles_torn(scene):
    """The store of candidate tiles is cut off in the middle, and overwritten with noise."""
    tiles = scene.folder / "tiles"
    more = ("--candidates", tiles, "--tile-key", scene.shared.keys / "tile.key.pem")
    with Aircraft(scene, *more) as aircraft:
        aircraft.has_package()
        scene.wait_for(lambda: (tiles / "tiles.mbtiles").exists(), 10)
    scene.attacked((tiles / "tiles.mbtiles").exists(), f"there is no store: {list(tiles.iterdir())}")
    whole = (tiles / "tiles.mbtiles").read_bytes()
    for data in (whole[:len(whole) // 2] + b"\x7f" * 50, b"noise" * 1000, b""):
        (tiles / "tiles.mbtiles").write_bytes(data)
        with Aircraft(scene, *more, autopilot=True) as aircraft:
            aircraft.has_package().connected()
            aircraft.flies_on(time.monotonic() - 1)
    return "flies three times"


@attack("H1", seconds=60)
def state_folder_is_a_file(scene):
    """The state folder's path leads to a file, then to a pipe."""
    answers = []
    for make in (lambda path: path.write_text("x"), os.mkfifo):
        path = scene.folder / f"state{len(answers)}"
        make(path)
        with Aircraft(scene, state=path, autopilot=True) as aircraft:
            aircraft.has_package().connected()
            scene.holds("state directory: failed" in aircraft.service.text(), "not reported")
            aircraft.flies_on(time.monotonic() - 1)
            answers.append("flies")
    return "state directory: failed; flies"


@attack("H2")
def clock_ten_seconds_behind(scene):
    """nadird --check twice, the second time with a clock ten seconds earlier."""
    host, state = clock(scene), scene.folder / "state.json"
    check = lambda: scene.run("nadird", "--package", scene.shared.built(), "--trust", scene.shared.root, "--airframe", "mini-07", "--state", state, "--check",
                              environment=host.environment())
    first = check()
    scene.attacked(first.code == 0, first.said[:150])
    host.set(-10)
    again = check()
    scene.holds(again.code == 0, f"refused: {again.said.strip()[:150]}")
    return "accepted"


@attack("H2", seconds=60)
def restart_with_a_wrong_clock(scene):
    """nadird is started again in the same boot with a clock ten minutes behind, in 1970, two years ahead."""
    host, state = clock(scene), scene.folder / "state"
    with Aircraft(scene, state=state, environment=host.environment()) as aircraft:
        aircraft.has_package()
        scene.wait_for(lambda: (state / "acceptance.json").exists(), 5, "no acceptance is remembered")
    for step in (-600, -round(time.time()) + DAY, 2 * YEAR):
        host.set(step)
        with Aircraft(scene, state=state, environment=host.environment()) as aircraft:
            aircraft.has_package()
            scene.holds("resumed" in aircraft.service.text(), f"not resumed: {aircraft.service.text()[-200:]}")
    return "resumed with each clock"


@attack("H2", seconds=60)
def reboot_in_flight_without_a_clock(scene):
    """Armed, killed, and started after a reboot (another boot id) with the clock of 1970."""
    host, state = clock(scene), scene.folder / "state"
    with Aircraft(scene, state=state, environment=host.environment(), autopilot=True, armed=True) as aircraft:
        aircraft.has_package().connected()
        record = state / "acceptance.json"
        scene.wait_for(lambda: record.exists() and '"airborne":true' in record.read_text().replace(" ", ""), 10,
                       f"the flight is not remembered: {record.exists() and record.read_text()[:200]}")
        scene.end(aircraft.service, number=9)
    lines = record.read_text()
    boot = pathlib.Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    scene.attacked(boot in lines, f"no boot id in acceptance.json: {lines[:150]}")
    # Another boot: the file is sealed with its own SHA-256, as nadird writes it.
    forge_boot(scene, record, boot)
    host.set(-round(time.time()) + 3600)
    with Aircraft(scene, state=state, environment=host.environment(), autopilot=True, armed=True) as aircraft:
        aircraft.has_package()
        scene.holds("resumed" in aircraft.service.text(), f"not resumed: {aircraft.service.text()[-200:]}")
        return "resumed by its digest"


def forge_boot(scene, record, boot):
    import hashlib
    text = record.read_text()
    body, _, seal = text.rstrip("\n").rpartition("\n")
    changed = body.replace(boot, "00000000-0000-4000-8000-000000000000")
    scene.attacked(hashlib.sha256((body + "\n").encode()).hexdigest() in seal or hashlib.sha256(body.encode()).hexdigest() in seal,
                   f"the seal is another: {seal[:80]}")
    whole = (changed + "\n").encode() if hashlib.sha256((body + "\n").encode()).hexdigest() in seal else changed.encode()
    old = hashlib.sha256(((body + "\n") if whole.endswith(b"\n") else body).encode()).hexdigest()
    record.write_text(changed + "\n" + seal.replace(old, hashlib.sha256(whole).hexdigest()) + "\n")


@attack("H3")
def future_date_by_hand(scene):
    """`--at` three weeks ahead with a state file, and then the clock of today."""
    state = scene.folder / "state.json"
    check = lambda *more: scene.run("nadird", "--package", scene.shared.built(), "--trust", scene.shared.root, "--airframe", "mini-07", "--state", state, "--check",
                                    *more)
    first = check("--at", day(50))
    scene.attacked(first.code == 0, f"refused as of then: {first.said[:150]}")
    again = check()
    scene.holds(again.code == 0, f"refused today: {again.said.strip()[:150]}")
    return "nothing is remembered of --at"


@attack("H3")
def clock_once_two_years_ahead(scene):
    """The clock once stood two years ahead when a package was accepted; today it is right again, and only a signed permit may correct it."""
    host, state, keys = clock(scene), scene.folder / "state.json", scene.shared.keys
    check = lambda *more: scene.run("nadird", "--package", package, "--trust", scene.shared.root, "--airframe", "mini-07", "--state", state, "--check", *more,
                                    environment=host.environment())
    package = scene.shared.built(expires=59)
    host.set(50 * DAY)
    scene.attacked(check().code == 0, "it was not accepted then")
    remembered = next((value for value in strings(json.loads(state.read_text())) if value[:4].isdigit() and value.endswith("Z")), None)
    scene.attacked(remembered, f"no time is remembered: {state.read_text()[:200]}")
    scene.holds(remembered < day(31), f"it remembers {remembered}")
    host.set(0)
    behind = check()
    scene.rejected(behind, "time.untrusted")
    permit, forged = scene.folder / "permit.json", scene.folder / "forged.json"
    for path, key in ((forged, "untrusted"), (permit, "signer")):
        made = scene.run("nadir", "keys", "permit-time", "--key", keys / f"{key}.key.pem", "--remembered", remembered, "--instead", day(0), "--expires",
                         day(30)[:10], "--out", path)
        scene.attacked(made.code == 0, made.said[:150])
    scene.rejected(check("--time-permit", forged), "permit", "key.unknown", "time.untrusted")
    permitted = check("--time-permit", permit)
    scene.holds(permitted.code == 0, f"the permit does not help: {permitted.said[:150]}")
    return f"remembered {remembered[:10]} at most; corrected by a signed permit alone"


def strings(document):
    if isinstance(document, str):
        yield document
    elif isinstance(document, dict):
        for value in document.values():
            yield from strings(value)
    elif isinstance(document, list):
        for value in document:
            yield from strings(value)


@attack("H2")
def new_package_damaged(scene):
    """The link `current` leads to a new package that is damaged: the last accepted one must come back by itself."""
    packages, state = scene.folder / "packages", scene.folder / "state"
    packages.mkdir()
    scene.shared.package(packages, "first")
    second = scene.shared.package(packages, "second", sequence=2)
    (second / "manifest.json").write_bytes((second / "manifest.json").read_bytes()[:100])
    current = packages / "current"
    current.symlink_to("first")
    with Aircraft(scene, package=current, state=state) as aircraft:
        aircraft.has_package()
        scene.wait_for(lambda: (state / "acceptance.json").exists(), 5, "no acceptance is remembered")
    current.unlink()
    current.symlink_to("second")
    with Aircraft(scene, package=current, state=state, autopilot=True) as aircraft:
        aircraft.has_package()
        scene.wait_for(lambda: any("last" in getattr(message, "text", "") for _, message in aircraft.autopilot.received), 8,
                       f"nothing is reported to the operator: {[m.text for _, m in aircraft.autopilot.received if m.get_type() == 'STATUSTEXT']}")
        text = next(message.text for _, message in aircraft.autopilot.received if "last" in getattr(message, "text", ""))
        return text


@attack("H1")
def wrong_usage_is_the_only_2(scene):
    """A root of trust that is gone, a key that is gone, a camera folder that is gone: systemd must start it again (no exit code 2)."""
    shared, answers = scene.shared, []
    root = scene.folder / "root.json"
    shutil.copy(shared.root, root)
    key = scene.folder / "link.key"
    for gone, code in ((root, None), (key, 70)):
        shutil.copy(shared.root, root)
        shutil.copy(shared.keys / "link.key", key)
        key.chmod(0o600)
        gone.unlink()
        started = scene.start("nadird", "--package", shared.built(), "--trust", root, "--airframe", shared.airframe(scene.folder), "--state",
                              scene.folder / "state", "--camera", "folder:/none", "--autopilot", "udpin:127.0.0.1:0", "--signing-key", key, "--memory-mb", 0,
                              "--listen", "127.0.0.1:0")
        scene.wait_for(lambda: not started.running(), 4)
        alive = started.running()
        ran = scene.end(started)
        answers.append("runs" if alive else str(ran.code))
        scene.holds(alive or ran.code != 2, f"ends with 2 when {gone.name} is gone: {ran.said[-150:]}")
    return f"without root: {answers[0]}; without key: {answers[1]}"
