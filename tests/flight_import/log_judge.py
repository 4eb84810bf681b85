#!/usr/bin/env python3
"""pymavlink and pyulog as independent readers and writers of logs, for the tests in C++.

usage: log_judge.py write-tlog FILE < messages   lines of JSON {"at": seconds since 1970, "message": NAME, FIELD: VALUE…}
       log_judge.py dataflash|tlog|ulog FILE     prints JSON: attitudes [[time_s, roll_deg, pitch_deg, yaw_deg]…],
                                                 heights [[time_s, above_home_m]…], positions [[time_s, lat, lon]…],
                                                 triggers, their number
Exit code 77: the reader (pyulog) is not installed here.
"""
import json
import math
import struct
import sys


def write_tlog(path):
    from pymavlink.dialects.v20 import ardupilotmega as dialect
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    with open(path, "wb") as out:
        for line in sys.stdin:
            fields = json.loads(line)
            at = fields.pop("at")
            mav.srcSystem = fields.pop("system", 1)
            kind = getattr(dialect, "MAVLink_" + fields.pop("message").lower() + "_message")
            types = dict(zip(kind.fieldnames, kind.fieldtypes))
            lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths))
            values = {name: b"" if types[name] == "char" else [0] * lengths[name] if lengths[name] else 0
                      for name in kind.fieldnames}
            assert set(fields) <= set(values), set(fields) - set(values)
            values.update(fields)
            out.write(struct.pack(">Q", round(at * 1e6)) + kind(**values).pack(mav))


def messages_of(path, kind):
    from pymavlink import DFReader, mavutil
    log = DFReader.DFReader_binary(path) if kind == "dataflash" else mavutil.mavlogfile(path)
    while (message := log.recv_msg()) is not None:
        yield message


def boot_s(message):
    """Of a dataflash message; logs of old firmware count milliseconds, and in GPS messages TimeMS is that of the GPS week."""
    for field, unit in (("TimeUS", 1e-6), ("T", 1e-3), ("TimeMS", 1e-3)):
        if field in message.get_fieldnames():
            return getattr(message, field) * unit
    raise ValueError(f"{message.get_type()} without a time")


def read_pymavlink(path, kind):
    result = {"attitudes": [], "heights": [], "positions": [], "triggers": 0}
    for m in messages_of(path, kind):
        name = m.get_type()
        if name == "ATT":
            result["attitudes"].append([boot_s(m), m.Roll, m.Pitch, m.Yaw])
        elif name == "POS":
            result["heights"].append([boot_s(m), m.RelHomeAlt])
        elif name == "GPS" and m.Status >= 3:
            result["positions"].append([boot_s(m), m.Lat, m.Lng])
        elif name == "CAM":
            result["triggers"] += 1
        elif name == "ATTITUDE":
            result["attitudes"].append([m.time_boot_ms * 1e-3] + [math.degrees(v) for v in (m.roll, m.pitch, m.yaw)])
        elif name == "GLOBAL_POSITION_INT":
            result["heights"].append([m.time_boot_ms * 1e-3, m.relative_alt * 1e-3])
        elif name == "GPS_RAW_INT" and m.fix_type >= 3:
            result["positions"].append([m.time_usec * 1e-6, m.lat * 1e-7, m.lon * 1e-7])
        elif name == "CAMERA_FEEDBACK":
            result["triggers"] += 1
    return result


def read_ulog(path):
    try:
        from pyulog import ULog
    except ImportError:
        print("pyulog is not installed", file=sys.stderr)
        sys.exit(77)
    log = ULog(path)
    data = {}
    for topic in log.data_list:
        if topic.multi_id == 0:
            data[topic.name] = topic.data
    result = {"attitudes": [], "heights": [], "positions": [], "triggers": 0}
    attitude = data.get("vehicle_attitude")
    if attitude is not None:
        rows = zip(attitude["timestamp"], *(attitude[f"q[{i}]"] for i in range(4)))
        for t, w, x, y, z in rows:
            result["attitudes"].append([
                t * 1e-6, math.degrees(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))),
                math.degrees(math.asin(max(-1, min(1, 2 * (w * y - z * x))))),
                math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))])
    local = data.get("vehicle_local_position")
    if local is not None:
        result["heights"] = [[t * 1e-6, -float(z)] for t, z, valid in
                             zip(local["timestamp"], local["z"], local["z_valid"]) if valid]
    gps = data.get("vehicle_gps_position")
    if gps is not None and "latitude_deg" in gps:
        result["positions"] = [[t * 1e-6, float(a), float(b)] for t, a, b, fix in
                               zip(gps["timestamp"], gps["latitude_deg"], gps["longitude_deg"], gps["fix_type"]) if fix >= 3]
    elif gps is not None:
        result["positions"] = [[t * 1e-6, a * 1e-7, b * 1e-7] for t, a, b, fix in
                               zip(gps["timestamp"], gps["lat"], gps["lon"], gps["fix_type"]) if fix >= 3]
    if "camera_capture" in data:
        result["triggers"] = len(data["camera_capture"]["timestamp"])
    return result


def main():
    command, path = sys.argv[1:3]
    if command == "write-tlog":
        write_tlog(path)
    else:
        json.dump(read_ulog(path) if command == "ulog" else read_pymavlink(path, command), sys.stdout)


if __name__ == "__main__":
    main()
