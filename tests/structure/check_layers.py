#!/usr/bin/env python3
"""Fails when a folder uses another that it may not use, when a header includes a library that costs too much there, when
two headers define a type of one name (in one program the linker would take the functions of one of them for both), or when a function is
called whose bits differ between processors.

usage: check_layers.py PROJECT_ROOT [--unused]

--unused  also names the permissions that nothing needs
"""
import pathlib
import re
import sys

# Which folder may include which. docs/architecture.md has the drawing. Libraries stand in libgeo, the aircraft's program in
# runtime, the ground's programs in tools.
ALLOWED = {
    # what everything stands on
    "base": "",
    "geodesy": "",
    "imagery": "base geodesy",
    "trust": "base geodesy",
    "token_keys": "base trust",
    "package": "base geodesy imagery trust",
    "package_delta": "base trust package",
    "package_export": "base geodesy imagery trust package",
    # where am I
    "vision": "base geodesy imagery package",
    "estimation": "base geodesy imagery package vision",
    "adjustment": "base geodesy vision",
    "ortho": "base geodesy imagery trust vision estimation",
    "recorder": "base geodesy imagery vision estimation",
    "flights": "base geodesy imagery vision estimation recorder",
    "flight_adjustment": "base geodesy imagery vision estimation adjustment recorder flights",
    "replay": "base geodesy imagery trust package vision estimation ortho recorder flights fixes cli report map_page",
    # to other machines and to people
    "mavlink": "base geodesy",
    "fixes": "geodesy estimation recorder mavlink",
    "http": "base",
    "cli": "base geodesy",
    "report": "",
    "map_page": "imagery http",
    "verify_request": "base package cli",
    "nadird_client": "base geodesy http cli",
    "flight_import": "base geodesy imagery vision estimation mavlink replay camera",
    "desk": "base geodesy imagery package vision estimation adjustment flight_import flights flight_adjustment replay http cli report map_page raster planning",
    "provision": "base geodesy imagery trust package vision estimation mavlink replay cli",
    # the ground's own
    "object_storage": "base http",
    "raster": "base geodesy imagery package object_storage",
    "mission_formats": "base geodesy package raster",
    "navigability": "base geodesy imagery package vision estimation raster",
    "package_build": "base geodesy imagery trust package vision ortho object_storage raster",
    "planning": "base geodesy imagery trust token_keys package vision raster package_build mission_formats",
    "datasets": "base geodesy imagery vision estimation replay cli raster planning",
    "catalogue": "base geodesy package raster",
    "upload": "base http imagery trust ortho",
    "candidates": "base geodesy imagery trust package ortho raster catalogue upload",
    "simulation": "base geodesy imagery package vision raster",
    # the aircraft
    "service": "base geodesy estimation",
    "camera": "base imagery service",
    "api": "base geodesy imagery package vision estimation http map_page service",
    "flight": "base geodesy imagery trust package vision estimation ortho recorder mavlink fixes cli api camera service",
    "runtime": "base trust package vision estimation ortho cli verify_request nadird_client service flight",
    # the ground's programs
    "commands": "base geodesy imagery trust token_keys package package_delta package_export vision estimation adjustment ortho recorder flights flight_adjustment replay mavlink upload object_storage raster package_build "
                "catalogue candidates simulation provision flight_import mission_formats navigability datasets cli report map_page verify_request nadird_client desk planning",
    "nadir_candidates": "base trust upload candidates http cli",
    "tools": "cli commands",
}
# Libraries that no header may include, and those that only the named folders may include at all.
HEAVY_IN_HEADERS = re.compile(r"^(ceres/|p11-kit/|exiv2/|gdal|ogr|cpl_|faiss/|CLI/|boost/beast|nlohmann/json\.hpp$|proj\.h$)")
ONLY_IN = [
    (re.compile(r"^(gdal|ogr|cpl_|proj\.h$)"), {"raster", "mission_formats", "package_build", "catalogue", "candidates", "datasets", "simulation", "commands"}),
    (re.compile(r"^curl/"), {"http", "upload", "object_storage"}),
    (re.compile(r"^p11-kit/"), {"token_keys"}),
    (re.compile(r"^CLI/"), {"cli"}),
    (re.compile(r"^faiss/"), {"vision"}),
    (re.compile(r"^ceres/"), {"adjustment", "provision"}),
    (re.compile(r"^exiv2/"), {"flight_import"}),
]
# Rounded differently by the C libraries of amd64 and arm64.
HYPOT = re.compile(r"\bstd::hypot\(")
TYPE = re.compile(r"^(?:struct|class|enum class) (\w+)(?: final)?(?:\s*:(?!:)[^{;]*)?\s*\{", re.MULTILINE)
INCLUDE = re.compile(r'^\s*#\s*include\s+["<]([^">]+)[">]')


def includes(path):
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        match = INCLUDE.match(line)
        if match:
            yield number, match.group(1)


def folder_of(path):
    """The folder of ALLOWED that a file, relative to the root, belongs to."""
    return path.parts[1] if len(path.parts) > 2 else path.parts[0]


def sources(root, pattern):
    for top in ("libgeo", "runtime", "tools"):
        yield from sorted((root / top).rglob(pattern))


def check(root):
    """All violations as lines of text, and the permissions that were needed."""
    found, used = [], set()
    for path in sources(root, "*.[ch]pp"):
        relative = path.relative_to(root)
        folder = folder_of(relative)
        if folder not in ALLOWED:
            found.append(f"{relative}: no folder of this name; ALLOWED in {__file__} lists them")
            continue
        for number, name in includes(path):
            where = f"{relative}:{number}"
            other = name.split("/")[0] if "/" in name else folder
            if other in ALLOWED and other != folder:
                used.add((folder, other))
                if other not in ALLOWED[folder].split():
                    found.append(f'{where}: "{folder}" may not use "{other}" ("{name}")')
            for library, folders in ONLY_IN:
                if library.match(name) and folder not in folders:
                    found.append(f'{where}: "{name}" may be included in {", ".join(sorted(folders))} only')
            if path.suffix == ".hpp" and HEAVY_IN_HEADERS.match(name):
                found.append(f'{where}: a header includes "{name}"; include it in a .cpp')
        if HYPOT.search(path.read_text(encoding="utf-8")):
            found.append(f"{relative}: std::hypot has other last bits on arm64; use hypotenuse() (geodesy/hypotenuse.hpp)")
    defined = {}
    for path in sources(root, "*.hpp"):
        for name in TYPE.findall(path.read_text(encoding="utf-8")):
            if defined.setdefault(name, path) != path:
                found.append(f"{path.relative_to(root)}: {name} is a type of {defined[name].relative_to(root)} already")
    return found, used


def cycles():
    """Folders of ALLOWED that may use themselves through others."""
    def reaches(start):
        seen, queue = set(), list(ALLOWED[start].split())
        while queue:
            name = queue.pop()
            if name not in seen:
                seen.add(name)
                queue += ALLOWED[name].split()
        return seen
    return [name for name in ALLOWED if name in reaches(name)]


def missing_in(drawing, root):
    """Folders of libgeo that the drawing of the architecture does not name."""
    text = drawing.read_text(encoding="utf-8")
    return [folder.name for folder in sorted((root / "libgeo").iterdir()) if folder.is_dir() and f">{folder.name}<" not in text]


def main():
    arguments = [argument for argument in sys.argv[1:] if argument != "--unused"]
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    found, used = check(pathlib.Path(arguments[0]))
    found += [f"ALLOWED lets {name} use itself" for name in cycles()]
    drawing = pathlib.Path(arguments[0]) / "docs/images/architecture.svg"
    found += [f"{drawing}: libgeo/{name} is missing" for name in missing_in(drawing, pathlib.Path(arguments[0]))]
    if "--unused" in sys.argv:
        found += [f"{folder} is allowed {other}, which nothing of it includes"
                  for folder, others in ALLOWED.items() for other in others.split() if (folder, other) not in used]
    print("\n".join(found) if found else "folders: each uses what it may")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
