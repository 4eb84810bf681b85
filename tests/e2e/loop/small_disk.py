"""A folder on a small file system of its own. Requires permission to mount; otherwise a context whose `folder` is None."""
import shutil
import subprocess


class SmallDisk:
    def __init__(self, folder, megabytes):
        self.wanted, self.megabytes, self.folder = folder, megabytes, None

    def __enter__(self):
        self.wanted.mkdir(parents=True)
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={self.megabytes}m", "tmpfs", str(self.wanted)],
                                 capture_output=True, check=False)
        self.folder = self.wanted if mounted.returncode == 0 else None
        return self

    def __exit__(self, *_):
        if self.folder is not None:
            subprocess.run(["umount", "--lazy", str(self.folder)], check=False)

    def share_used(self):
        usage = shutil.disk_usage(self.folder)
        return usage.used / usage.total
