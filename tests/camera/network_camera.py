#!/usr/bin/env python3
"""A network camera: RTSP with its pictures interleaved in TCP (RFC 2326), each JPEG as RFC 2435 has it.

    network_camera.py PORT PER_SECOND RECORDING    its pictures in turn, live, until killed; tells its port when it listens

RECORDING holds motion JPEG as OpenCV writes it: baseline, 4:2:0 chroma, the standard Huffman tables. Sides divisible by
16. PORT 0: any that is free.
"""
import itertools
import socket
import struct
import sys
import threading
import time

PAYLOAD_BYTES = 1400
JPEG = 26  # RTP payload type
QUANT_TABLES_FOLLOW = 255
DESCRIPTION = ("v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=camera\r\nc=IN IP4 0.0.0.0\r\nt=0 0\r\n"
               "m=video 0 RTP/AVP 26\r\na=control:track\r\n")


class Picture:
    def __init__(self, data):
        self.tables = b""
        at = 2
        while True:  # segments: marker, length, body
            marker, length = data[at + 1], struct.unpack_from(">H", data, at + 2)[0]
            body = data[at + 4:at + 2 + length]
            at += 2 + length
            if marker == 0xDB:
                self.tables += b"".join(body[i + 1:i + 65] for i in range(0, len(body), 65))
            elif marker == 0xC0:
                self.height, self.width = struct.unpack_from(">HH", body, 1)
            elif marker == 0xDA:
                self.scan = data[at:]
                return

    def payloads(self):
        """(bytes, whether they end the picture)"""
        for offset in range(0, len(self.scan), PAYLOAD_BYTES):
            head = struct.pack(">IBBBB", offset, 1, QUANT_TABLES_FOLLOW, self.width // 8, self.height // 8)
            if offset == 0:
                head += struct.pack(">HH", 0, len(self.tables)) + self.tables
            yield head + self.scan[offset:offset + PAYLOAD_BYTES], offset + PAYLOAD_BYTES >= len(self.scan)


def play(viewer, pictures, per_second):
    sequence = itertools.count()
    begin = time.monotonic()
    try:
        for shown, picture in enumerate(itertools.cycle(pictures)):
            time.sleep(max(0.0, begin + shown / per_second - time.monotonic()))
            ticks = int(90000 * shown / per_second) & 0xFFFFFFFF
            for payload, last in picture.payloads():
                rtp = struct.pack(">BBHII", 0x80, JPEG | (0x80 if last else 0), next(sequence) & 0xFFFF, ticks, 7)
                viewer.sendall(b"$\0" + struct.pack(">H", len(rtp) + len(payload)) + rtp + payload)
    except OSError:
        pass  # the viewer has gone


def serve(viewer, pictures, per_second):
    try:
        answer_all(viewer, pictures, per_second)
    except OSError:
        pass  # the viewer has gone


def answer_all(viewer, pictures, per_second):
    asked = viewer.makefile("rb")
    while True:
        request = asked.readline().decode().split()
        if not request:
            return
        fields = {}
        while line := asked.readline().decode().strip():
            name, _, value = line.partition(":")
            fields[name.lower()] = value.strip()
        method, body = request[0], ""
        answer = ["RTSP/1.0 200 OK", "CSeq: " + fields["cseq"], "Session: 1"]
        if method == "OPTIONS":
            answer.append("Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN")
        elif method == "DESCRIBE":
            body = DESCRIPTION
            answer += ["Content-Type: application/sdp", f"Content-Base: {request[1]}/", f"Content-Length: {len(body)}"]
        elif method == "SETUP":
            answer.append("Transport: RTP/AVP/TCP;unicast;interleaved=0-1")
        viewer.sendall(("\r\n".join(answer) + "\r\n\r\n" + body).encode())
        if method == "PLAY":
            threading.Thread(target=play, args=(viewer, pictures, per_second), daemon=True).start()


def main():
    with open(sys.argv[3], "rb") as file:
        recording = file.read()
    # Within the data of a JPEG no 0xff is followed by 0xd8 or 0xd9.
    pictures = [Picture(b"\xff\xd8" + rest.partition(b"\xff\xd9")[0]) for rest in recording.split(b"\xff\xd8")[1:]]
    with socket.create_server(("127.0.0.1", int(sys.argv[1]))) as door:
        print(door.getsockname()[1], flush=True)
        while True:
            viewer, _ = door.accept()
            threading.Thread(target=serve, args=(viewer, pictures, float(sys.argv[2])), daemon=True).start()


if __name__ == "__main__":
    main()
