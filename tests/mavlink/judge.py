#!/usr/bin/env python3
"""pymavlink as the independent judge of single frames, for the tests in C++.

usage: judge.py write [--version 1|2] [--key HEX] [--timestamp N] [--step N] [--link N] [--system N] < messages
           lines of JSON {"message": NAME, FIELD: VALUE…}; prints each as a frame in hexadecimal, signed --step ticks
           after the one before
       judge.py read [--key HEX] < frames
           frames in hexadecimal, a line each; prints a line of JSON with what each says, or {"refused": reason}
"""
import argparse
import json
import math
import sys

from pymavlink.dialects.v20 import ardupilotmega as dialect


def connection(args):
    mav = dialect.MAVLink(None, srcSystem=args.system, srcComponent=1)
    mav.robust_parsing = False
    if args.key:
        mav.signing.secret_key = bytes.fromhex(args.key)
        mav.signing.sign_outgoing = True
        mav.signing.timestamp = args.timestamp
        mav.signing.link_id = args.link
    return mav


def write(args):
    mav = connection(args)
    for number, line in enumerate(sys.stdin):
        mav.signing.timestamp = args.timestamp + number * args.step
        fields = json.loads(line)
        kind = getattr(dialect, "MAVLink_" + fields.pop("message").lower() + "_message")
        types = dict(zip(kind.fieldnames, kind.fieldtypes))
        lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths))
        values = {name: b"" if types[name] == "char" else [0] * lengths[name] if lengths[name] else 0
                  for name in kind.fieldnames}
        unknown = set(fields) - set(values)
        assert not unknown, f"{kind.msgname} has no {unknown}"
        for name, value in fields.items():
            values[name] = value.encode() if isinstance(value, str) else math.nan if value is None else value
        print(kind(**values).pack(mav, force_mavlink1=args.version == 1).hex())


def plain(value):
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return [plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def read(args):
    mav = connection(args)
    for line in sys.stdin:
        data = bytes.fromhex(line)
        try:
            messages = mav.parse_buffer(data) or []
            if len(messages) != 1:
                raise dialect.MAVError(f"{len(messages)} messages")
        except dialect.MAVError as error:
            mav = connection(args)
            print(json.dumps({"refused": str(error)}))
            continue
        message = messages[0]
        fields = {name: plain(value) for name, value in message.to_dict().items()}
        header = message.get_header()
        fields.update(system=header.srcSystem, component=header.srcComponent, sequence=header.seq,
                      signed=message.get_signed(), length=len(data))
        print(json.dumps(fields))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("job", choices=["read", "write"])
    parser.add_argument("--version", type=int, default=2)
    parser.add_argument("--key")
    parser.add_argument("--timestamp", type=int, default=1)
    parser.add_argument("--step", type=int, default=1)
    parser.add_argument("--link", type=int, default=0)
    parser.add_argument("--system", type=int, default=1)
    args = parser.parse_args()
    {"read": read, "write": write}[args.job](args)


main()
