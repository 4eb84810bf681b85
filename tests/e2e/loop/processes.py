"""Programs that run concurrently, each with its own log, stopped in order."""
import os
import pathlib
import resource
import signal
import subprocess
import time

SERVICE_NICENESS = -10  # of a process or of a kernel's autogroup: as heavy as CPUWeight=1000, which nadird.service asks for


def favour():
    """Gives this process and its session the CPU weight of a service, because what stands in for the aircraft's hardware
    must not be delayed by other work. No effect where the kernel or permissions do not allow it."""
    try:
        os.nice(SERVICE_NICENESS)
        pathlib.Path("/proc/self/autogroup").write_text(f"{SERVICE_NICENESS}\n", encoding="ascii")
    except OSError:
        pass


class Program:
    def __init__(self, name, command, log_folder, favoured=False, environment=None):
        self.name = name
        self.log = log_folder / f"{name}.log"
        self.file = open(self.log, "w", encoding="utf-8")
        self.process = subprocess.Popen([str(word) for word in command], stdin=subprocess.DEVNULL, stdout=self.file,
                                        stderr=subprocess.STDOUT, start_new_session=favoured,
                                        preexec_fn=favour if favoured else None,
                                        env={**os.environ, **(environment or {})})
        self.pid = self.process.pid

    def running(self):
        return self.process.poll() is None

    def end(self, number=signal.SIGTERM, patience_s=40):
        """Its exit code. Killed when it does not end by itself."""
        if self.running():
            self.process.send_signal(number)
        try:
            code = self.process.wait(patience_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        self.file.close()
        return code

    def text(self):
        return self.log.read_text(encoding="utf-8", errors="replace")

    def tail(self, lines=8):
        return "\n".join(self.text().splitlines()[-lines:])

    def memory_mb(self):
        try:
            with open(f"/proc/{self.pid}/statm", encoding="ascii") as file:
                return int(file.read().split()[1]) * resource.getpagesize() / 1e6
        except (OSError, IndexError, ValueError):
            return None


class Programs:
    """A context: what was started is ended, the latest first, whatever happens."""

    def __init__(self, log_folder, favoured=False):
        self.log_folder, self.favoured, self.started = log_folder, favoured, []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for program in reversed(self.started):
            if not program.file.closed:
                program.end()

    def start(self, name, command, environment=None):
        self.started.append(Program(name, command, self.log_folder, self.favoured, environment))
        return self.started[-1]

    def wait_until_says(self, program, text, seconds=300):
        """Until its log holds `text`."""
        until = time.monotonic() + seconds
        while text not in program.text():
            if not program.running() or time.monotonic() > until:
                raise SystemExit(f"{program.name} did not begin:\n{program.tail()}")
            time.sleep(0.05)

    def wait_for(self, program, seconds):
        """Until `program` ends. SystemExit when another one ends before it, or it takes too long."""
        until = time.monotonic() + seconds
        while program.running():
            for other in self.started:
                if other is not program and not other.running():
                    raise SystemExit(f"{other.name} ended with {other.process.returncode} in flight:\n{other.tail()}")
            if time.monotonic() > until:
                raise SystemExit(f"{program.name} did not end in {seconds} s:\n{program.tail()}")
            time.sleep(0.2)
