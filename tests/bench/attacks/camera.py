"""Who can write into the camera's folder: pictures that are bombs, pipes, links, floods and lies."""
import os
import shutil
import struct
import subprocess
import time
import zlib

from . import shared as inputs
from .aircraft import Aircraft
from .registry import attack


def honest(scene, seed=1):
    """A picture of the camera's size."""
    def make(folder):
        inputs.support.write_jpeg(folder / "frame.jpg", 320, 240, seed=seed)
    return scene.shared.once(f"picture-{seed}", make) / "frame.jpg"


def deliver(aircraft, name, data):
    """A file comes into the camera's folder as programs write it: whole, by its final name."""
    hidden = aircraft.frames / f".{name}.part"
    hidden.write_bytes(data)
    hidden.rename(aircraft.frames / name)


def came(aircraft):
    """Frames that were read, or refused, as far as the API says."""
    state = aircraft.get() or {}
    frames = state.get("frames", {})
    return frames.get("received", 0) + frames.get("dropped", 0)


def noticed(aircraft):
    return [text for text in aircraft.texts() if text.startswith(("camera", "frame"))]


def survives(scene, aircraft, name, data, answer, patience_s=8):
    """The picture comes; then honest ones; they are read, and everything else goes on."""
    since, before, said = time.monotonic(), came(aircraft), len(noticed(aircraft))
    deliver(aircraft, name, data)
    noted = scene.wait_for(lambda: came(aircraft) > before or len(noticed(aircraft)) > said
                           or not (aircraft.frames / name).exists(), 4)
    return goes_on(scene, aircraft, since, noted, answer, patience_s)


def goes_on(scene, aircraft, since, noted, answer, patience_s=8):
    before = came(aircraft)
    for number in range(3):
        deliver(aircraft, f"zz{number}.jpg", honest(scene, number % 2 + 1).read_bytes())
        time.sleep(0.3)
    scene.attacked(noted or noticed(aircraft) or came(aircraft) > 3, f"nothing was read: {aircraft.get().get('frames')}")
    scene.wait_for(lambda: came(aircraft) > before, patience_s, "honest pictures are not read any more")
    aircraft.flies_on(since)
    said = noticed(aircraft)
    return f"{answer}; {said[-1][:70] if said else 'honest pictures go on'}"


def png(width, height, rows, bits=8):
    """A PNG of grey zeros that claims this size and has so many rows."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    packer = zlib.compressobj(9)
    row = bytes(1 + width * bits // 8)
    packed = b"".join(packer.compress(row) for _ in range(rows)) + packer.flush()
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)) + chunk(
        b"IDAT", packed) + chunk(b"IEND", b"")


def with_size(jpeg, width, height):
    """The JPEG with another size in its header."""
    data, at = bytearray(jpeg), 2
    while data[at + 1] not in (0xC0, 0xC1, 0xC2):
        at += 2 + struct.unpack(">H", data[at + 2:at + 4])[0]
    data[at + 5:at + 9] = struct.pack(">HH", height, width)
    return bytes(data)


def progressive(scene, scans):
    """A picture of the right size whose last scan comes so many times."""
    folder = scene.folder / "progressive"
    folder.mkdir()
    (folder / "flat.ppm").write_bytes(b"P6 320 240 255\n" + bytes([90, 100, 110]) * 320 * 240)
    subprocess.run(["gdal_translate", "-q", "-of", "JPEG", "-co", "PROGRESSIVE=YES", folder / "flat.ppm", folder / "flat.jpg"], check=True,
                   stdin=subprocess.DEVNULL)
    data = (folder / "flat.jpg").read_bytes()
    starts = [at for at in range(len(data) - 1) if data[at:at + 2] == b"\xff\xda"]
    end = data.rindex(b"\xff\xd9")
    pieces = [data[a:b] for a, b in zip(starts, [*starts[1:], end])]
    # A scan with Huffman tables of its own brings them before it: only the marker SOS and its data are repeated.
    shortest = min((piece[:piece.index(b"\xff\xc4")] if b"\xff\xc4" in piece[2:] else piece for piece in pieces[1:]), key=len)
    return data[:end] + shortest * scans + data[end:]


@attack("M6", memory_mb=200)
def picture_of_four_gigapixels(scene):
    """A JPEG of 10 KB that claims 65 500 by 65 500 pixels."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        data = with_size(honest(scene).read_bytes(), 65_500, 65_500)
        return survives(scene, aircraft, "a.jpg", data, "not decoded")


@attack("M6", memory_mb=200)
def png_of_nine_hundred_megapixels(scene):
    """A PNG of 900 megapixels that compresses to a few hundred kilobytes."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        return survives(scene, aircraft, "a.png", png(30_000, 30_000, 8_000), "not decoded")


@attack("M6", memory_mb=200)
def progressive_picture_of_150000_scans(scene):
    """A JPEG of the right size with 150 000 progressive scans, each of which a decoder works through."""
    data = progressive(scene, 150_000)
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        scene.attacked(data.count(b"\xff\xda") > 150_000, "there are no scans in it")
        return survives(scene, aircraft, "a.jpg", data, f"{len(data) / 1e6:.1f} MB of scans")


@attack("M6", memory_mb=200)
def many_pictures_of_scans(scene):
    """Twenty such pictures of 3000 scans each, one after the other: the watchdog must be fed all the same."""
    data = progressive(scene, 3_000)
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        since = time.monotonic()
        for number in range(20):
            deliver(aircraft, f"a{number:02}.jpg", data)
            time.sleep(0.1)
        return goes_on(scene, aircraft, since, False, "20 of them")


@attack("M11")
def pipe_as_a_picture(scene):
    """A pipe, a socket, a folder and a device named like pictures."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        since = time.monotonic()
        os.mkfifo(aircraft.frames / "a.jpg")
        (aircraft.frames / "b.jpg").mkdir()
        (aircraft.frames / "c.jpg").symlink_to("/dev/zero")
        (aircraft.frames / "d.jpg").symlink_to("/dev/tty")
        time.sleep(0.7)
        return goes_on(scene, aircraft, since, True, "not opened")


@attack()
def picture_that_links_to_a_secret(scene):
    """A link named like a picture that leads to a file of the service's user."""
    with Aircraft(scene, "--record", scene.folder / "record", "--keep-frames", autopilot=True) as aircraft:
        aircraft.has_package().connected()
        since = time.monotonic()
        secret = scene.folder / "secret.txt"
        secret.write_text("the-secret-of-this-aircraft\n" * 50)
        (aircraft.frames / "a.jpg").symlink_to(secret)
        time.sleep(0.7)
        answer = goes_on(scene, aircraft, since, True, "not shown")
        text = aircraft.service.text() + str(aircraft.get())
        scene.end(aircraft.service)
    recorded = b"".join(path.read_bytes() for path in (scene.folder / "record").iterdir())
    scene.holds("the-secret" not in text and b"the-secret" not in recorded, "the secret is in the log, the API or the recording")
    return answer


@attack(seconds=60)
def flood_of_pictures(scene):
    """3000 empty and half pictures at once."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        data, since = honest(scene).read_bytes(), time.monotonic()
        for number in range(3_000):
            (aircraft.frames / f"a{number:04}.jpg").write_bytes(data[:number % 700])
        return goes_on(scene, aircraft, since, True, "flies on", patience_s=20)


@attack()
def half_pictures(scene):
    """Pictures cut off at every hundredth byte, and with noise in the middle."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        data, since = honest(scene).read_bytes(), time.monotonic()
        for number in range(1, 40):
            cut = data[:number * len(data) // 40]
            deliver(aircraft, f"a{number:03}.jpg", cut if number % 2 else data[:700] + os.urandom(300) + data[1000:])
            time.sleep(0.03)
        return goes_on(scene, aircraft, since, False, "39 of them")


@attack()
def old_picture_shown_again(scene):
    """The same picture over and over under new names, as if the aircraft stood still."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        data = honest(scene).read_bytes()
        for number in range(30):
            deliver(aircraft, f"a{number:03}.jpg", data)
            time.sleep(0.1)
        scene.attacked(came(aircraft) >= 5, f"nothing was read: {aircraft.get().get('frames')}")
        state = aircraft.get()
        fixes = [message for _, message in aircraft.autopilot.received if message.get_type() == "GPS_INPUT" and message.fix_type >= 3]
        scene.holds(not fixes and state["anchors"]["accepted"] == 0, "a position was made of it")
        return f"{state['frames']['received']} read, no anchor, no fix"


@attack()
def name_of_a_picture_that_writes_lines(scene):
    """A picture whose name has line breaks, quotes and escape sequences, and one that leads out of the folder."""
    with Aircraft(scene, "--record", scene.folder / "record", autopilot=True) as aircraft:
        aircraft.has_package().connected()
        deliver(aircraft, 'a\nnadird: the package is accepted\x1b[2J".jpg', b"no picture")
        answer = survives(scene, aircraft, 'b\n\x1b]0;owned\x07.jpg', honest(scene).read_bytes(), "one line each")
        text = aircraft.service.text()
        scene.holds("\x1b" not in text, "an escape sequence is in the log")
        scene.holds(not any(line.startswith("nadird: the package is accepted") for line in text.splitlines()), "a file's name became a line")
        return answer


@attack(memory_mb=300)
def replay_of_a_bomb(scene):
    """The same four gigapixels in a folder that `nadir replay` reads on the ground."""
    folder = scene.folder / "flight" / "frames"
    folder.mkdir(parents=True)
    (scene.folder / "flight" / "camera.yaml").write_text(inputs.support.CAMERA.format(width=320, height=240))
    rows = ["frame,time_s,agl_m,heading_deg,pitch_deg,roll_deg"]
    for number in range(4):
        shutil.copy(honest(scene), folder / f"{number}.jpg")
        rows.append(f"{number}.jpg,{number}.0,100,90,0,0")
    (scene.folder / "flight" / "telemetry.csv").write_text("\n".join(rows) + "\n")
    (folder / "2.jpg").write_bytes(with_size(honest(scene).read_bytes(), 65_500, 65_500))
    ran = scene.run("nadir", "replay", "--frames", folder, "--telemetry", scene.folder / "flight" / "telemetry.csv", "--camera",
                    scene.folder / "flight" / "camera.yaml", "--start", "8.499,47.4", "--out", scene.folder / "out")
    return scene.rejected(ran, "2.jpg", code=2)
