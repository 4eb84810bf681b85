#!/usr/bin/env python3
"""Fails when a layer of libgeo includes one above it, when a header includes a library that costs too much there, or when two
headers define a type of one name: in one program the linker would take the functions of one of them for both.

usage: check_layers.py PROJECT_ROOT
"""
import pathlib
import re
import sys

# Bottom to top: a layer may include itself and those before it.
LAYERS = ["base", "geodesy", "imagery", "trust", "package", "vision", "estimation", "ortho", "recorder", "exchange", "sync", "ground", "candidates",
          "simulation"]
# The aircraft's program may not use these at all.
PLANNER_ONLY = {"ground", "candidates", "simulation", "sync"}
# Libraries that no header may include, and those that only the named layers may include at all.
HEAVY_IN_HEADERS = re.compile(r"^(ceres/|gdal|ogr|cpl_|faiss/|CLI/|nlohmann/json\.hpp$|proj\.h$)")
ONLY_IN = [(re.compile(r"^(gdal|ogr|cpl_|proj\.h$)"), {"ground", "candidates", "simulation"}), (re.compile(r"^curl/"), {"sync"})]
TYPE = re.compile(r"^(?:struct|class|enum class) (\w+)(?: final)?(?:\s*:(?!:)[^{;]*)?\s*\{", re.MULTILINE)
INCLUDE = re.compile(r'^\s*#\s*include\s+["<]([^">]+)[">]')


def includes(path):
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        match = INCLUDE.match(line)
        if match:
            yield number, match.group(1)


def check(root):
    """All violations as lines of text."""
    found = []
    libgeo = root / "libgeo"
    for folder in sorted(p for p in libgeo.iterdir() if p.is_dir()):
        if folder.name not in LAYERS:
            found.append(f"{folder}: no layer of this name; LAYERS in {__file__} lists them")
    for path in sorted(libgeo.rglob("*.[ch]pp")):
        layer = path.relative_to(libgeo).parts[0]
        if layer not in LAYERS:
            continue
        for number, name in includes(path):
            where = f"{path.relative_to(root)}:{number}"
            other = name.split("/")[0]
            if other in LAYERS and LAYERS.index(other) > LAYERS.index(layer):
                found.append(f'{where}: layer "{layer}" includes "{name}" of a layer above it')
            if other in ("tools", "runtime", "framework", "replay"):
                found.append(f'{where}: the library includes "{name}" of a program')
            for library, layers in ONLY_IN:
                if library.match(name) and layer not in layers:
                    found.append(f'{where}: "{name}" may be included in {", ".join(sorted(layers))} only')
    for top in ("libgeo", "tools", "runtime"):
        for path in sorted((root / top).rglob("*.hpp")):
            for number, name in includes(path):
                if HEAVY_IN_HEADERS.match(name):
                    found.append(f'{path.relative_to(root)}:{number}: a header includes "{name}"; include it in a .cpp')
    defined = {}
    for top in ("libgeo", "tools", "runtime"):
        for path in sorted((root / top).rglob("*.hpp")):
            for name in TYPE.findall(path.read_text(encoding="utf-8")):
                if defined.setdefault(name, path) != path:
                    found.append(f"{path.relative_to(root)}: {name} is a type of {defined[name].relative_to(root)} already")
    for path in sorted((root / "runtime").rglob("*.[ch]pp")):
        for number, name in includes(path):
            if name.split("/")[0] in PLANNER_ONLY:
                found.append(f'{path.relative_to(root)}:{number}: the aircraft includes "{name}" of the planner')
    return found


def main():
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    found = check(pathlib.Path(sys.argv[1]))
    print("\n".join(found) if found else "layers: in order")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
