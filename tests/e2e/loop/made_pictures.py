"""Pictures that no renderer paints: what a camera in trouble puts into the folder."""
import contextlib
import os
import shutil
import struct
import threading
import time
import zlib


def black(frames, width, height):
    """One picture that shows nothing: a PNG, for which Python needs no library."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    rows = chunk(b"IDAT", zlib.compress(bytes((width + 1) * height), 1))
    put(frames, b"\x89PNG\r\n\x1a\n" + header + rows + chunk(b"IEND", b""), "black.png")


def put(frames, data, name):
    """Written elsewhere and moved into place, as a camera program should."""
    beside = frames.parent / name
    beside.write_bytes(data)
    os.replace(beside, frames / f"{time.monotonic_ns()}-{name}")


def newest(frames, count=1):
    """The latest pictures of the renderer, the oldest of them first."""
    return sorted(frames.glob("frame_*.jpg"))[-count:]


def again(frames, patience_s=2.0):
    """The renderer's next picture comes twice, bit for bit."""
    before, until = newest(frames), time.monotonic() + patience_s
    while newest(frames) == before and time.monotonic() < until:
        time.sleep(0.005)
    put(frames, newest(frames)[-1].read_bytes(), "again.jpg")


def backlog(frames, count):
    """What the renderer painted last, all at once: a camera that had held it back."""
    held = frames.parent / "held"
    held.mkdir(exist_ok=True)
    for picture in newest(frames, count):
        shutil.copy(picture, held / picture.name)
    for picture in sorted(held.iterdir()):
        os.replace(picture, frames / f"{time.monotonic_ns()}-{picture.name}")


@contextlib.contextmanager
def carried(beside, frames):
    """What a second renderer puts into `beside` goes on into the camera's folder, under a name of its own: two renderers
    that hear the same pose would give their pictures the same one."""
    done = threading.Event()

    def carry():
        while not done.wait(0.005):
            for picture in sorted(beside.glob("frame_*.jpg")):
                os.replace(picture, frames / f"{picture.stem}_{beside.name}.jpg")

    carrier = threading.Thread(target=carry)
    carrier.start()
    try:
        yield
    finally:
        done.set()
        carrier.join()
