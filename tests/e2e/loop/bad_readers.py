"""Readers of the service's events that are slow (a few bytes a second) or dead (nothing at all). They reconnect when the
service drops them; dead ones every 20 s, because they do not notice."""
import socket
import threading
import time

PERIOD_S = 0.5
DEAD_FOR_S = 20
REQUEST = b"GET /v1/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


class BadReaders:
    """A context; every second reader is dead. `opened` counts them all."""

    def __init__(self, count):
        self.count, self.opened = count, 0
        self.open = {}  # socket: (when it came, dead)
        self.stopped = threading.Event()
        self.thread = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stopped.set()
        if self.thread is not None:
            self.thread.join()
        for end in self.open:
            end.close()

    def begin(self, port):
        if self.count == 0:
            return
        self.thread = threading.Thread(target=self._run, args=(port,), daemon=True)
        self.thread.start()

    def _run(self, port):
        while not self.stopped.wait(PERIOD_S):
            for end, (since, dead) in list(self.open.items()):
                if time.monotonic() - since > DEAD_FOR_S if dead else not self._sips(end):
                    del self.open[end]
                    end.close()
            while len(self.open) < self.count and self._come(port):
                pass

    def _come(self, port):
        end = socket.socket()
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        try:
            end.settimeout(1)
            end.connect(("127.0.0.1", port))
            end.sendall(REQUEST)
            end.setblocking(False)
        except OSError:
            end.close()
            return False
        self.opened += 1
        self.open[end] = (time.monotonic(), self.opened % 2 == 0)
        return True

    @staticmethod
    def _sips(end):
        """Reads a few bytes; False when the service has closed the connection."""
        try:
            return len(end.recv(16)) > 0
        except BlockingIOError:
            return True
        except OSError:
            return False
