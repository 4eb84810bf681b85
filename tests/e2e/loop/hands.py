"""Faults injected from outside: system time changed, tiles corrupted."""
import mmap
import pathlib
import struct
import subprocess

STEP_CLOCK = pathlib.Path(__file__).resolve().parents[2] / "support" / "step_clock.c"


class HostClock:
    """The time of day of one program. environment(): for that program; empty where there is no C compiler."""

    def __init__(self, folder):
        self.file, self.library = folder / "clock-step", folder / "step_clock.so"
        self.set(0)
        built = subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", self.library, STEP_CLOCK, "-ldl"], capture_output=True,
                               check=False)
        self.works = built.returncode == 0

    def environment(self):
        return {"LD_PRELOAD": str(self.library), "NADIR_STEP_CLOCK": str(self.file)} if self.works else {}

    def set(self, seconds):
        if not self.file.exists():
            self.file.write_bytes(bytes(8))
        with open(self.file, "r+b") as file, mmap.mmap(file.fileno(), 8) as view:
            view[:] = struct.pack("<q", seconds)


def spoil_tiles(package):
    """Inverts every second kilobyte in the middle of the imagery; a second call restores it."""
    files = sorted((path for path in package.rglob("*") if path.suffix in (".mbtiles", ".tif")),
                   key=lambda path: path.stat().st_size)
    with open(files[-1], "r+b") as file:
        size = files[-1].stat().st_size
        for offset in range(size // 20 // 4096 * 4096, size * 19 // 20, 2048):
            file.seek(offset)
            part = file.read(1024)
            file.seek(offset)
            file.write(bytes(byte ^ 0xFF for byte in part))
    return files[-1]
