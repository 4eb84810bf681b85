"""The registry of attacks, what runs one and measures the programs, and the answers that a row can have.

An attack is a function of a module of this folder, registered by @attack. It gets a Scene, and

  - proves with scene.attacked() that it really attacked: the forged frame has arrived, the view is in the file;
  - says with scene.holds() what must hold; the first that does not is why the row falls;
  - returns the program's answer, in a few words.

Its docstring is the attack in one sentence. A row falls, too, when a program needs more memory or time than the row's
bound, is killed by a signal that nobody sent, or ends as an unhandled error does.
"""
import dataclasses
import os
import pathlib
import resource
import shutil
import signal
import subprocess
import tempfile
import threading
import time

ATTACKS = {}  # name: Attack, in the order of the modules
ALLOWED_MB, ALLOWED_S = 250, 30  # of one program, of one row; nadird is started without its reserve of 192 MB
SAMPLED_S = 0.01
MAX_ADDRESS_SPACE = 12 << 30  # a fall does not take the machine with it
NEVER_SAID = ("terminate called", "what():", "core dumped", "[json.exception", "fault of the program", "AddressSanitizer",
              "runtime error:", "std::bad_alloc")


class Fell(Exception):
    """Something that must hold does not."""


class NotAttacked(Exception):
    """The attack did not arrive: the row proves nothing, and counts as fallen."""


class NotRun(Exception):
    """This machine does not allow the attack. Printed, and no fall."""


@dataclasses.dataclass
class Attack:
    name: str
    attacker: str
    function: object
    review: str  # its number in the review, or ""
    memory_mb: int
    seconds: int

    @property
    def sentence(self):
        return " ".join(self.function.__doc__.split())


def attack(review="", memory_mb=ALLOWED_MB, seconds=ALLOWED_S):
    """review: what of the review the row replays. memory_mb, seconds: the bounds of each program, of the row."""
    def register(function):
        attacker = function.__module__.rpartition(".")[2]
        name = f"{attacker}.{function.__name__}"
        ATTACKS[name] = Attack(name, attacker, function, review, memory_mb, seconds)
        return function
    return register


@dataclasses.dataclass
class Ran:
    """A program that has ended."""
    code: int  # negative: of the signal that ended it
    out: str
    err: str
    seconds: float
    cpu_s: float  # user and system: independent of the machine's load
    peak_mb: float

    @property
    def said(self):
        return self.out + self.err

    def line(self, word):
        """The first line with the word."""
        return next((line.strip() for line in self.said.splitlines() if word in line), "")


class Measured:
    """A started program: its output in files, its peak memory sampled while it runs."""

    def __init__(self, command, folder, environment=None, umask=-1):
        self.command = [str(word) for word in command]
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="run.", dir=folder))
        self.out, self.err = self.folder / "out", self.folder / "err"

        self.begun = time.monotonic()
        with open(self.out, "wb") as out, open(self.err, "wb") as err:
            self.process = subprocess.Popen(self.command, stdin=subprocess.DEVNULL, stdout=out, stderr=err, umask=umask,
                                            env={**os.environ, **(environment or {})})
        for what, most in ((resource.RLIMIT_AS, MAX_ADDRESS_SPACE), (resource.RLIMIT_CORE, 0)):
            try:
                resource.prlimit(self.process.pid, what, (most, most))
            except (ProcessLookupError, PermissionError):  # it has ended already, or is another user's by now
                pass
        self.pid, self.peak_mb, self.seconds, self.cpu_s = self.process.pid, 0.0, None, 0.0
        self.sampler = threading.Thread(target=self._sample, daemon=True)
        self.sampler.start()

    def _sample(self):
        while self.process.returncode is None and self.look():
            time.sleep(SAMPLED_S)

    def look(self):
        """Updates the peak; False when the program is gone."""
        try:
            with open(f"/proc/{self.pid}/status", encoding="ascii", errors="replace") as file:
                for line in file:
                    if line.startswith("VmHWM:"):
                        self.peak_mb = max(self.peak_mb, int(line.split()[1]) / 1000)
                        return True
        except OSError:
            pass
        return False

    def running(self):
        """False once it has ended; then cpu_s is what it used."""
        if self.process.returncode is None:
            pid, status, usage = os.wait4(self.pid, os.WNOHANG)
            if pid == 0:
                return True
            self.cpu_s = usage.ru_utime + usage.ru_stime
            self.process.returncode = os.waitstatus_to_exitcode(status)
        return False

    def text(self):
        return "".join(path.read_text(encoding="utf-8", errors="replace") for path in (self.out, self.err))

    def finish(self, limit_s):
        """Ran; None, and killed, when it takes longer."""
        until, late = time.monotonic() + limit_s, False
        while self.running():
            if time.monotonic() > until and not late:
                late = True
                self.look()
                self.process.kill()
            time.sleep(SAMPLED_S)
        self.seconds = time.monotonic() - self.begun
        self.sampler.join()
        if late:
            return None
        read = lambda path: path.read_text(encoding="utf-8", errors="replace")
        return Ran(self.process.returncode, read(self.out), read(self.err), self.seconds, self.cpu_s, self.peak_mb)


class Scene:
    """What one attack works with: a folder of its own, the inputs that all share, and programs that are measured."""

    def __init__(self, row, programs, shared, folder):
        self.row, self.programs, self.shared, self.folder = row, programs, shared, folder
        self.started, self.code, self.peak_mb, self.closers = [], None, 0.0, []

    # ---- programs

    def program(self, name):
        return self.programs / name

    def run(self, name, *args, environment=None, umask=-1, limit_s=None):
        """A program of ours, to its end. It falls when it hangs, is ended by a signal, or shows its insides."""
        started = Measured([self.program(name), *args], self.folder, environment, umask)
        ran = started.finish(limit_s or self.row.seconds)
        self.peak_mb = max(self.peak_mb, started.peak_mb)
        if ran is None:
            raise Fell(f"{name} did not end within {limit_s or self.row.seconds} s: {started.text()[-120:].strip()}")
        self.code = ran.code
        self._sound(name, ran.code, ran.said)
        return ran

    def start(self, name, *args, environment=None, umask=-1):
        """A program of ours that goes on; ended with the row."""
        started = Measured([self.program(name), *args], self.folder, environment, umask)
        self.started.append((name, started))
        return started

    def end(self, started, number=signal.SIGTERM, patience_s=20):
        """Ends a started program in order, and judges how it ended."""
        name = next(name for name, other in self.started if other is started)
        self.started = [(other_name, other) for other_name, other in self.started if other is not started]
        if started.running() and number:
            started.process.send_signal(number)
        ran = started.finish(patience_s)
        self.peak_mb = max(self.peak_mb, started.peak_mb)
        if ran is None:
            raise Fell(f"{name} did not end {patience_s} s after signal {number}")
        self.code = ran.code
        if number == signal.SIGKILL and ran.code == -signal.SIGKILL:
            return ran
        self._sound(name, ran.code, ran.said)
        return ran

    def close(self):
        """Whatever happened: nothing stays behind."""
        for closer in reversed(self.closers):
            closer()
        for _, started in self.started:
            if started.running():
                started.process.kill()
            started.finish(10)
            self.peak_mb = max(self.peak_mb, started.peak_mb)

    @staticmethod
    def _sound(name, code, said):
        if code < 0:
            raise Fell(f"{name} was ended by {signal.Signals(-code).name}")
        if code not in (0, 1, 2, 70, 130):
            raise Fell(f"{name} ended with {code}, which no page names")
        for words in NEVER_SAID:
            if words in said:
                raise Fell(f"{name} shows its insides: {words}")

    # ---- judgement

    def attacked(self, condition, what):
        if not condition:
            raise NotAttacked(f"the attack did not arrive: {what}")

    def holds(self, condition, otherwise):
        if not condition:
            raise Fell(otherwise)

    def rejected(self, ran, *words, code=1):
        """The program has rejected it with this exit code, and said one of the words."""
        self.holds(ran.code == code, f"exit code {ran.code} instead of {code}: {ran.said.strip()[:120]}")
        self.holds(not words or any(word in ran.said for word in words),
                   f"no word of {' or '.join(words)}: {ran.said.strip()[:120]}")
        return next((word for word in words if word in ran.said), "rejected")

    def wait_for(self, condition, seconds, what=None):
        """The value of the condition once it is true. Without `what` it may stay false."""
        until = time.monotonic() + seconds
        while True:
            value = condition()
            if value or time.monotonic() > until:
                break
            time.sleep(0.03)
        if what is not None:
            self.holds(value, f"{what} (waited {seconds} s)")
        return value


@dataclasses.dataclass
class Row:
    attack: Attack
    verdict: str  # "holds", "FALLS", "NOT ATTACKED", "NOT RUN"
    answer: str
    code: int
    peak_mb: float
    seconds: float


def run_attack(row, programs, shared, folder):
    """The Row of one attack."""
    folder = pathlib.Path(tempfile.mkdtemp(prefix=row.name + ".", dir=folder))
    scene = Scene(row, programs, shared, folder)
    shared.prepare()
    begun = time.monotonic()
    try:
        verdict, answer = "holds", row.function(scene)
    except Fell as why:
        verdict, answer = "FALLS", str(why)
    except NotAttacked as why:
        verdict, answer = "NOT ATTACKED", str(why)
    except NotRun as why:
        verdict, answer = "NOT RUN", str(why)
    except Exception as error:  # the attack's own fault: the row proves nothing
        verdict, answer = "NOT ATTACKED", f"{type(error).__name__}: {error}"
        if os.environ.get("NADIR_ATTACKS_TRACE"):
            raise
    finally:
        seconds = time.monotonic() - begun
        scene.close()
        shutil.rmtree(folder, ignore_errors=True)
    if verdict == "holds" and scene.peak_mb > row.memory_mb:
        verdict, answer = "FALLS", f"{scene.peak_mb:.0f} MB of memory, at most {row.memory_mb}; {answer}"
    if verdict == "holds" and seconds > row.seconds:
        verdict, answer = "FALLS", f"{seconds:.0f} s, at most {row.seconds}; {answer}"
    return Row(row, verdict, " ".join(str(answer).split()), scene.code, scene.peak_mb, seconds)
