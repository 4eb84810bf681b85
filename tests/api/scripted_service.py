"""Starts and steers test_api_server (scripted_server.cpp)."""
import subprocess


class ScriptedService:
    def __init__(self, program, *options):
        self._process = subprocess.Popen([program, *map(str, options)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        line = self._process.stdout.readline()
        assert line.startswith("listening on "), f"the server said {line!r}"
        self.port = int(line.split()[-1])
        self.url = f"http://127.0.0.1:{self.port}"

    def command(self, line):
        """A state's name, "stall" or "go"."""
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def stop(self):
        if self._process.stdin:
            self._process.stdin.close()
        self._process.wait(timeout=60)
        self._process.stdout.close()
        return self._process.returncode
