#!/usr/bin/env python3
"""Fails when a program needs, itself or through other libraries, what the aircraft must not carry.

usage: check_links.py PROGRAM
Walks the DT_NEEDED entries with readelf, so that a library that is missing here is seen as well.
"""
import functools
import re
import subprocess
import sys

FORBIDDEN = re.compile(
    r"^lib(gdal|exiv2|proj|spatialite|curl|curl-gnutls|opencv_highgui|opencv_imgcodecs|opencv_videoio)\.so")


@functools.cache
def known_libraries():
    """Name to path, as the dynamic linker would find them."""
    text = subprocess.run(["/sbin/ldconfig", "-p"], capture_output=True, text=True, check=True).stdout
    found = {}
    for line in text.splitlines():
        if " => " in line:
            name, path = line.strip().split(" => ")
            found.setdefault(name.split()[0], path)
    return found


@functools.cache
def needed(path):
    text = subprocess.run(["readelf", "-d", path], capture_output=True, text=True, check=True).stdout
    return re.findall(r"\(NEEDED\).*\[([^\]]+)\]", text)


def main():
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    seen, queue, bad = {}, [(sys.argv[1], [sys.argv[1]])], []
    while queue:
        path, trail = queue.pop()
        for name in needed(path):
            if name in seen:
                continue
            seen[name] = trail + [name]
            if FORBIDDEN.match(name):
                bad.append(" -> ".join(seen[name]))
            elif name in known_libraries():
                queue.append((known_libraries()[name], seen[name]))
    print("\n".join(["must not be linked:"] + sorted(bad)) if bad else f"{len(seen)} libraries, none forbidden")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
