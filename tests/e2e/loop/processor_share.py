"""A computer that is too slow, or too busy: so many milliseconds of processor in each period, for a program and all of its
threads. By a control group; Linux, as root."""
import os
import pathlib

ROOTS = (pathlib.Path("/sys/fs/cgroup/cpu"), pathlib.Path("/sys/fs/cgroup"))  # version 1 and 2


class ProcessorShare:
    """A context. text: 60/1000 is 60 ms of each 1000 ms."""

    def __init__(self, text):
        self.ms, self.period_ms = (float(part) for part in text.split("/"))
        self.folder = None

    def __enter__(self):
        root = next(root for root in ROOTS if (root / "cgroup.procs").exists() or root == ROOTS[-1])
        self.folder = root / f"nadir-{os.getpid()}"
        quota_us, period_us = round(1000 * self.ms), round(1000 * self.period_ms)
        try:
            self.folder.mkdir()
            if (self.folder / "cpu.max").exists():
                (self.folder / "cpu.max").write_text(f"{quota_us} {period_us}")
            else:
                (self.folder / "cpu.cfs_period_us").write_text(str(period_us))
                (self.folder / "cpu.cfs_quota_us").write_text(str(quota_us))
        except OSError as error:
            self.__exit__()
            raise SystemExit(f"--processor needs a control group, for which one must be root and the controller cpu be there: {error}") from error
        return self

    def __exit__(self, *_):
        if self.folder.is_dir():
            self.folder.rmdir()

    def words(self, command):
        """The command, inside."""
        return ["/bin/sh", "-c", 'echo $$ > "$0" && exec "$@"', self.folder / "cgroup.procs", *command]
