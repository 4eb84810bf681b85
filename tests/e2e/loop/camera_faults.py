"""Frames that the renderer does not produce: those of a faulty camera."""
import contextlib
import os
import shutil
import struct
import threading
import time
import zlib


def black(frames, width, height):
    """One black frame: a PNG, for which Python needs no library."""
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
    """The latest frames of the renderer, the oldest of them first."""
    return sorted(frames.glob("frame_*.jpg"))[-count:]


def again(frames, patience_s=2.0):
    """Delivers the renderer's next frame twice, bit for bit."""
    before, until = newest(frames), time.monotonic() + patience_s
    while newest(frames) == before and time.monotonic() < until:
        time.sleep(0.005)
    put(frames, newest(frames)[-1].read_bytes(), "again.jpg")


def backlog(frames, count):
    """Delivers the renderer's latest frames all at once, as a camera with a backlog."""
    held = frames.parent / "held"
    held.mkdir(exist_ok=True)
    for frame in newest(frames, count):
        shutil.copy(frame, held / frame.name)
    for frame in sorted(held.iterdir()):
        os.replace(frame, frames / f"{time.monotonic_ns()}-{frame.name}")


@contextlib.contextmanager
def carried(beside, frames):
    """Moves what a second renderer writes into `beside` to the camera's folder under distinct names: two renderers
    with the same pose would use the same name."""
    done = threading.Event()

    def carry():
        while not done.wait(0.005):
            for frame in sorted(beside.glob("frame_*.jpg")):
                os.replace(frame, frames / f"{frame.stem}_{beside.name}.jpg")

    carrier = threading.Thread(target=carry)
    carrier.start()
    try:
        yield
    finally:
        done.set()
        carrier.join()
