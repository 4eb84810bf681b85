#!/usr/bin/env python3
"""Stands in for the service in the harness's own test: sends the truth, with noise, as GPS_INPUT ten times a second.

usage: stand_in.py LINK_PORT TRUTH_PORT [--offset-m M] [--key-file FILE]
"""
import argparse
import pathlib
import random
import select
import signal
import socket
import sys
import time

from pymavlink.dialects.v20 import ardupilotmega as dialect


def listening(port):
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind(("127.0.0.1", port))
    return end


def codec(component, key=None):
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=component)
    mav.robust_parsing = True
    if key is not None:
        mav.signing.secret_key, mav.signing.sign_outgoing = key, True
        mav.signing.timestamp = int((time.time() - 1420070400) * 1e5)
    return mav


def gps_input(truth, generator, offset_m):
    lat_int, lon_int = ((truth.lat_int + round((generator.gauss(0, 2) + offset_m) / 0.0111)),
                        truth.lon_int + round(generator.gauss(0, 2) / 0.0074))
    return dialect.MAVLink_gps_input_message(0, 0, 0, 0, 0, 3, lat_int, lon_int, truth.alt, 1, 1.5, truth.vn, truth.ve,
                                             truth.vd, 0.6, 4, 6, 10)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("link_port", type=int)
    parser.add_argument("truth_port", type=int)
    parser.add_argument("--offset-m", type=float, default=0)
    parser.add_argument("--key-file")
    args = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    key = bytes.fromhex(pathlib.Path(args.key_file).read_text().strip()) if args.key_file else None
    link, truth_end = listening(args.link_port), listening(args.truth_port)
    mav, truth_mav, generator = codec(197, key), codec(197), random.Random(1)
    print("listening", flush=True)
    autopilot, truth, next_s = None, None, 0.0
    while True:
        for end in select.select([link, truth_end], [], [], 0.02)[0]:
            data, sender = end.recvfrom(65536)
            if end is link:
                autopilot = sender
            else:
                for message in truth_mav.parse_buffer(data) or []:
                    truth = message if message.get_type() == "SIM_STATE" else truth
        now = time.monotonic()
        if truth is not None and autopilot is not None and now >= next_s:
            next_s = now + 0.1
            link.sendto(gps_input(truth, generator, args.offset_m).pack(mav), autopilot)
            mav.seq = (mav.seq + 1) % 256


if __name__ == "__main__":
    main()
