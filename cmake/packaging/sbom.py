#!/usr/bin/env python3
"""A software bill of materials (SPDX 2.3, JSON) for each Debian package of a folder, beside it.

usage: sbom.py BUILD PACKAGES

What a program consists of is asked of those who know: the package's own ELF files name the libraries that are loaded, ninja's
dependency log the headers that its objects were compiled with and build.ninja the static libraries that were linked, and
dpkg the Debian package and version that each of these files belongs to. The same packages give the same bytes; the date is
SOURCE_DATE_EPOCH.
"""
import datetime
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

TARGETS = {"nadir": "bin/nadir", "nadird": "bin/nadird", "nadir-candidates": "bin/nadir-candidates",
           "nadird-camera-video": "bin/nadir_camera_video.so", "nadird-camera-gstreamer": "bin/nadir_camera_gstreamer.so",
           "nadir-network-onnxruntime": "bin/nadir_network_onnxruntime.so"}


MAVLINK = "(MAVLink's headers)"
# The folder of the libraries and of dpkg's database: nothing, or the sysroot of a cross build (.ci/package.sh).
ROOT = os.environ.get("DPKG_ADMINDIR", "").removesuffix("/var/lib/dpkg")


def output(*args, check=True):
    return subprocess.run(args, capture_output=True, text=True, check=check).stdout


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


class Dpkg:
    """Which package a file belongs to, and what is known of that package."""

    def __init__(self):
        self._owners = {}

    def owners(self, paths):
        new = sorted({p for p in paths if p not in self._owners})
        for start in range(0, len(new), 500):
            # /lib is /usr/lib here, but dpkg knows a file by the name that its package has for it.
            asked = [name for p in new[start:start + 500] for name in {p, ROOT + p.removeprefix(ROOT).removeprefix("/usr")}]
            for line in output("dpkg", "-S", *asked, check=False).splitlines():
                package, _, path = line.partition(": ")
                for name in (path, ROOT + "/usr" + path.removeprefix(ROOT)):
                    self._owners.setdefault(name, package.split(",")[0].split(":")[0])
        return {self._owners[p] for p in paths if p in self._owners}

    def describe(self, package):
        fields = output("dpkg-query", "-W", "-f", "${Package}\t${Version}\t${Architecture}\t${Maintainer}\t${Homepage}\n", package)
        return fields.splitlines()[0].split("\t")


def linked_objects(graph, target):
    """(objects, static libraries) that `target` is made of, through all of the project's own libraries."""
    objects, archives, queue, seen = set(), set(), [target], set()
    while queue:
        name = queue.pop()
        if name in seen:
            continue
        seen.add(name)
        for need in graph.get(name, []):
            if need.endswith(".o"):
                objects.add(need)
            elif need.endswith(".a"):
                if need.startswith("/"):
                    archives.add(need)
                else:
                    queue.append(need)
    return objects, archives


def read_graph(build):
    """output: its inputs, of build.ninja."""
    graph = {}
    text = (build / "build.ninja").read_text().replace("$\n", "")
    for line in text.splitlines():
        if line.startswith("build "):
            made, _, rest = line[6:].partition(": ")
            inputs = [word for word in re.split(r"(?<!\$) ", rest)[1:] if word not in ("|", "||", "")]
            for name in made.split():
                graph.setdefault(name, inputs)
    return graph


def read_headers(build):
    """object: the headers that it was compiled with, outside of the project."""
    headers, current = {}, None
    for line in output("ninja", "-C", str(build), "-t", "deps").splitlines():
        if line and not line.startswith((" ", "ninja:")):
            current = headers.setdefault(line.split(": #deps")[0], set())
        elif current is not None and (path := os.path.normpath(build.resolve() / line.strip())).startswith(ROOT + "/usr/"):
            current.add(path)
        elif current is not None and "/ardupilotmega/" in line:
            current.add(MAVLINK)  # made by pymavlink's generator
    return headers


def loaded_libraries(program):
    names = re.findall(r"\(NEEDED\).*\[([^\]]+)\]", output("readelf", "-d", str(program)))
    if ROOT:
        known = {path.name: str(path) for path in pathlib.Path(ROOT).glob("usr/lib/*-linux-gnu/*.so*")}
    else:
        known = dict(re.findall(r"^\s*(\S+) \([^)]*\) => (\S+)$", output("/sbin/ldconfig", "-p"), re.M)[::-1])
    return {os.path.realpath(known[name]) if os.path.exists(known.get(name, "")) else name for name in names} | \
           {known[name] for name in names if name in known}


def spdx_id(*parts):
    return "SPDXRef-" + re.sub(r"[^A-Za-z0-9.-]", "-", "-".join(parts))


def bill_of(deb, build, dpkg, graph, headers, created):
    fields = dict(re.findall(r"^(\S+): (.*)$", output("dpkg-deb", "-f", str(deb)), re.M))
    name = fields["Package"]
    root = spdx_id("Package", name)
    packages = [{"SPDXID": root, "name": name, "versionInfo": fields["Version"], "packageFileName": deb.name,
                 "supplier": "Organization: The Nadir authors", "downloadLocation": "NOASSERTION", "filesAnalyzed": False,
                 "checksums": [{"algorithm": "SHA256", "checksumValue": sha256(deb)}],
                 "licenseConcluded": "GPL-3.0-or-later" if name == "nadir" else "Apache-2.0",
                 "licenseDeclared": "Apache-2.0", "copyrightText": "2026 The Nadir authors",
                 "externalRefs": [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl",
                                   "referenceLocator": f"pkg:deb/{name}@{fields['Version']}?arch={fields['Architecture']}"}]}]
    relations = [{"spdxElementId": "SPDXRef-DOCUMENT", "relationshipType": "DESCRIBES", "relatedSpdxElement": root}]
    files, used, compiled = [], {}, set()  # used: Debian package: how
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["dpkg-deb", "-x", str(deb), folder], check=True)
        for path in sorted(pathlib.Path(folder).rglob("*")):
            if not path.is_file() or path.is_symlink():
                continue
            shown = "./" + str(path.relative_to(folder))
            files.append({"SPDXID": spdx_id("File", shown[2:]), "fileName": shown,
                          "checksums": [{"algorithm": "SHA1", "checksumValue": hashlib.sha1(path.read_bytes()).hexdigest()},
                                        {"algorithm": "SHA256", "checksumValue": sha256(path)}],
                          "licenseConcluded": "NOASSERTION", "copyrightText": "NOASSERTION"})
            relations.append({"spdxElementId": root, "relationshipType": "CONTAINS", "relatedSpdxElement": files[-1]["SPDXID"]})
            if path.read_bytes()[:4] == b"\x7fELF":
                for package in dpkg.owners(loaded_libraries(path)):
                    used[package] = "DYNAMIC_LINK"
    if name in TARGETS:
        objects, archives = linked_objects(graph, TARGETS[name])
        compiled = {header for item in objects for header in headers.get(item, ())}
        for package in dpkg.owners(compiled - {MAVLINK}):
            used.setdefault(package, "BUILD_DEPENDENCY_OF")
        for package in dpkg.owners(archives):
            used[package] = "STATIC_LINK"
        if not objects:
            raise SystemExit(f"sbom: {TARGETS[name]} is not in {build}/build.ninja")
        if not TARGETS[name].endswith(".so"):
            used["libjs-leaflet"] = "CONTAINS"  # embedded texts (libgeo/map_page)
    for package in sorted(used):
        source, version, architecture, maintainer, homepage = dpkg.describe(package)
        item = spdx_id("Debian", source)
        packages.append({"SPDXID": item, "name": source, "versionInfo": version, "downloadLocation": "NOASSERTION",
                         "supplier": "Organization: " + maintainer, "filesAnalyzed": False,
                         **({"homepage": homepage} if homepage else {}),
                         "licenseConcluded": "NOASSERTION", "licenseDeclared": "NOASSERTION", "copyrightText": "NOASSERTION",
                         "externalRefs": [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl",
                                           "referenceLocator": f"pkg:deb/debian/{source}@{version}?arch={architecture}"}]})
        pair = (item, root) if used[package].endswith("_OF") else (root, item)
        relations.append({"spdxElementId": pair[0], "relationshipType": used[package], "relatedSpdxElement": pair[1]})
    if MAVLINK in compiled:
        version = re.search(r"^pymavlink==(\S+)", pathlib.Path(".ci/python-requirements.txt").read_text(), re.M)[1]
        packages.append({"SPDXID": "SPDXRef-PyPI-pymavlink", "name": "pymavlink", "versionInfo": version,
                         "downloadLocation": "NOASSERTION", "filesAnalyzed": False, "licenseConcluded": "MIT",
                         "licenseDeclared": "LGPL-3.0-only", "copyrightText": "NOASSERTION", "comment": "the headers that its generator makes",
                         "externalRefs": [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl",
                                           "referenceLocator": f"pkg:pypi/pymavlink@{version}"}]})
        relations.append({"spdxElementId": root, "relationshipType": "CONTAINS", "relatedSpdxElement": "SPDXRef-PyPI-pymavlink"})
    return {"spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT", "name": deb.stem,
            "documentNamespace": f"https://spdx.org/spdxdocs/{deb.stem}-{sha256(deb)}",
            "creationInfo": {"created": created, "creators": ["Tool: cmake/packaging/sbom.py"]},
            "packages": packages, "files": files, "relationships": relations}


def main():
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    build, folder = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    epoch = int(os.environ["SOURCE_DATE_EPOCH"])
    created = datetime.datetime.fromtimestamp(epoch, datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    dpkg, graph, headers = Dpkg(), read_graph(build), read_headers(build)
    debs = sorted(folder.glob("*.deb"))
    if not debs:
        print(f"sbom: no .deb in {folder}", file=sys.stderr)
        return 2
    for deb in debs:
        bill = bill_of(deb, build, dpkg, graph, headers, created)
        deb.with_suffix(".spdx.json").write_text(json.dumps(bill, indent=1, ensure_ascii=False) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
