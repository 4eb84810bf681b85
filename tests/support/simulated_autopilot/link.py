"""MAVLink over datagrams or a byte stream (a pseudo-terminal), signed or not."""
import os
import socket
import time

from pymavlink.dialects.v20 import ardupilotmega as dialect

SIGNING_EPOCH = 1420070400  # 2015-01-01


class Udp:
    """Sends to one address; answers come back to the same socket."""

    def __init__(self, host, port):
        self.address = (host, port)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)

    def write(self, data):
        try:
            self.socket.sendto(data, self.address)
        except OSError:  # no listener yet, or the buffer is full: a datagram is lost, as on any link
            pass

    def read(self):
        try:
            return self.socket.recv(65536)
        except OSError:
            return b""

    def fileno(self):
        return self.socket.fileno()

    def close(self):
        self.socket.close()


class Stream:
    """A descriptor: one end of a pseudo-terminal, or a serial port that is set up already."""

    def __init__(self, descriptor):
        self.descriptor = descriptor
        os.set_blocking(descriptor, False)

    def write(self, data):
        try:
            os.write(self.descriptor, data)
        except OSError:
            pass

    def read(self):
        try:
            return os.read(self.descriptor, 65536)
        except OSError:
            return b""

    def fileno(self):
        return self.descriptor

    def close(self):
        os.close(self.descriptor)


def open_transport(text):
    """udpout:HOST:PORT or file:PATH (a pseudo-terminal's other end)."""
    kind, _, rest = text.partition(":")
    if kind == "udpout":
        host, _, port = rest.rpartition(":")
        return Udp(host, int(port))
    if kind == "file":
        return Stream(os.open(rest, os.O_RDWR | os.O_NOCTTY))
    raise ValueError(f"'{text}': expected udpout:HOST:PORT or file:PATH")


class Link:
    def __init__(self, transport, key=None, system=1, component=1, unix_s=time.time):
        self.transport = transport
        self.mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self.mav.robust_parsing = True
        self.unix_s = unix_s
        self.cut = False
        self.received, self.refused, self.sent = 0, 0, 0
        if key is not None:
            self.sign(key)

    def sign(self, key, timestamp=0):
        signing = self.mav.signing
        signing.secret_key, signing.sign_outgoing, signing.link_id = key, True, 0
        signing.timestamp = max(timestamp, int((self.unix_s() - SIGNING_EPOCH) * 1e5))
        signing.allow_unsigned_callback = None

    def stop_signing(self):
        self.mav.signing.secret_key, self.mav.signing.sign_outgoing = None, False

    @property
    def signed(self):
        return self.mav.signing.secret_key is not None

    def send(self, message):
        data = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        self.sent += 1
        if not self.cut:
            self.transport.write(data)

    def receive(self):
        """What arrived, but for what is damaged or, on a signed link, not signed by a holder of the key."""
        messages = []
        while data := self.transport.read():
            if self.cut:
                continue
            for message in self.mav.parse_buffer(data) or []:
                if message.get_type() == "BAD_DATA":
                    self.refused += 1
                else:
                    self.received += 1
                    messages.append(message)
        return messages
