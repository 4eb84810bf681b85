"""How attacks see that they arrive: files that are opened, and ports that somebody calls."""
import ctypes
import os
import select
import socket
import struct
import threading

IN_OPEN = 0x20
LIBC = ctypes.CDLL(None, use_errno=True)


class Opened:
    """A context that counts how often the file of a folder is opened, and calls `at_first` right after the first time."""

    def __init__(self, path, at_first=None):
        self.name, self.at_first, self.count = path.name.encode(), at_first, 0
        self.descriptor = LIBC.inotify_init1(os.O_CLOEXEC | os.O_NONBLOCK)
        if self.descriptor < 0 or LIBC.inotify_add_watch(self.descriptor, os.fsencode(path.parent), IN_OPEN) < 0:
            raise OSError(ctypes.get_errno(), "inotify")
        self.stopped = threading.Event()
        self.thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stopped.set()
        self.thread.join()
        os.close(self.descriptor)

    def _watch(self):
        while not self.stopped.is_set():
            if not select.select([self.descriptor], [], [], 0.02)[0]:
                continue
            events = os.read(self.descriptor, 65536)
            while events:
                _, _, _, length = struct.unpack_from("iIII", events)
                name, events = events[16:16 + length].rstrip(b"\0"), events[16 + length:]
                if name != self.name:
                    continue
                self.count += 1
                if self.count == 1 and self.at_first:
                    self.at_first()


class Listener:
    """A context: a port on loopback that counts who calls, reads what they send, and answers `answer` once."""

    def __init__(self, answer=b""):
        self.answer, self.calls, self.received = answer, 0, b""
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.stopped = threading.Event()
        self.thread = threading.Thread(target=self._accept, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stopped.set()
        self.thread.join()
        self.socket.close()

    def _accept(self):
        while not self.stopped.is_set():
            if not select.select([self.socket], [], [], 0.02)[0]:
                continue
            peer, _ = self.socket.accept()
            self.calls += 1
            with peer:
                peer.settimeout(1)
                try:
                    self.received += peer.recv(65536)
                    peer.sendall(self.answer)
                except OSError:
                    pass
