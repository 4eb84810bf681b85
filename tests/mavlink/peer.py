#!/usr/bin/env python3
"""pymavlink as the other end of a real link, for link_test.cpp.

usage: peer.py udp PORT | udpbind | tcp | pty  KEY
Prints where it is ("port N", "path P"), then greets until somebody answers, answers every message with a STATUSTEXT
"received NAME", and ends at the STATUSTEXT "bye" with a line of JSON: how often each message came, and what was refused.
"""
import collections
import json
import os
import select
import socket
import sys
import time
import tty

from pymavlink.dialects.v20 import ardupilotmega as dialect


class Wire:
    """One place to read and write bytes, whatever they travel over."""

    def __init__(self, kind, arguments):
        self.address = None
        if kind in ("udp", "udpbind"):
            self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.socket.bind(("127.0.0.1", 0))
            if kind == "udp":
                self.address = ("127.0.0.1", int(arguments[0]))
            place = f"port {self.socket.getsockname()[1]}"
        elif kind == "tcp":
            self.listener = socket.create_server(("127.0.0.1", int(arguments[0]) if arguments else 0))
            place = f"port {self.listener.getsockname()[1]}"
        else:
            self.master, self.slave = os.openpty()
            tty.setraw(self.slave)
            place = f"path {os.ttyname(self.slave)}"
        self.kind = kind
        print(place, flush=True)
        if kind == "tcp":
            self.socket, _ = self.listener.accept()
        self.fd = self.master if kind == "pty" else self.socket.fileno()

    def read(self):
        if self.kind == "pty":
            return os.read(self.master, 4096)
        data, address = self.socket.recvfrom(4096)
        self.address = self.address or address
        return data

    def write(self, data):
        if self.kind == "pty":
            os.write(self.master, data)
        elif self.kind == "tcp":
            self.socket.sendall(data)
        elif self.address:
            self.socket.sendto(data, self.address)


def main():
    kind, *arguments, key = sys.argv[1:]
    wire = Wire(kind, arguments)
    mav = dialect.MAVLink(wire, srcSystem=1, srcComponent=1)
    mav.robust_parsing = True
    mav.signing.secret_key = bytes.fromhex(key)
    mav.signing.sign_outgoing = True
    mav.signing.timestamp = int((time.time() - 1420070400) * 1e5)
    received, refused = collections.Counter(), 0
    while True:
        if not select.select([wire.fd], [], [], 0.05)[0]:
            mav.heartbeat_send(1, 3, 0, 0, 4)
            continue
        data = wire.read()
        if not data:
            break
        for message in mav.parse_buffer(data) or []:
            name = message.get_type()
            if name == "BAD_DATA" or not message.get_signed():
                refused += 1
                continue
            received[name] += 1
            if name == "STATUSTEXT" and message.text == "bye":
                print(json.dumps({"received": received, "refused": refused}), flush=True)
                return
            mav.statustext_send(6, f"received {name}".encode())


main()
