"""Ports of this machine that nobody else is given."""
import itertools
import os
import socket

# Below those that the system gives to whoever asks for any.
PORTS = itertools.count(15000 + 7 * os.getpid() % 16000)


def free_port(kind=socket.SOCK_DGRAM):
    """One that stays free until the program takes it that is told of it."""
    for port in PORTS:
        try:
            with socket.socket(socket.AF_INET, kind) as end:
                end.bind(("127.0.0.1", port))
            return port
        except OSError:
            pass
