#!/usr/bin/env python3
"""Builds the Debian packages of nadird and nadir-candidates from a build folder, nadird's twice, and tries them in a throw-away
copy of this system.

usage: check_packages.py PROJECT_ROOT BUILD
The copy is an overlay: this system with whatever is installed below it, and everything that changes in memory; so no package
is fetched. `./run package --check` does the same, and more, in a fresh Debian. Without root or overlays that part says NOT
TESTED and the exit code is 77.
"""
import gzip
import io
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile

FORBIDDEN = ("gdal", "proj", "curl", "exiv2", "imgcodecs", "videoio", "highgui")

# In the copy. /older.deb is the same package with a lower version.
SCENARIO = r'''
set -e
export PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive
fail() { echo "$*"; exit 1; }
dpkg --unpack /older.deb >/dev/null && dpkg --configure --force-depends nadird >/dev/null 2>&1
test "$(stat -c '%U %a' /var/lib/nadir-flights)" = "nadir 750" || fail "no folder for recordings"
test "$(stat -c '%U %a' /etc/nadir/keys)" = "root 700" || fail "/etc/nadir/keys is not root's alone"
test ! -e /etc/systemd/system/multi-user.target.wants/nadird.service || fail "enabled without configuration"
install -d -o nadir -g nadir /var/lib/nadir
echo memory >/var/lib/nadir/aircraft.json
echo NADIRD_OPTIONS=--help >>/etc/nadir/nadird.env
echo secret >/etc/nadir/keys/link.key
dpkg --force-confold --force-depends -i /new.deb >/dev/null 2>&1 || fail "the upgrade fails"
test "$(nadird --version)" = "nadird $VERSION" || fail "nadird --version: $(nadird --version)"
code=0; nadird --check 2>/dev/null || code=$?
test $code = 2 || fail "nadird --check without a package ends with $code"
grep -q NADIRD_OPTIONS=--help /etc/nadir/nadird.env || fail "the upgrade lost the configuration"
test -e /var/lib/nadir/aircraft.json || fail "the upgrade lost the state"
dpkg -r nadird >/dev/null 2>&1
test ! -e /usr/bin/nadird || fail "removed, but the program is there"
test -e /var/lib/nadir/aircraft.json -a -e /etc/nadir/nadird.env || fail "removing took state or configuration along"
touch /var/lib/nadir-flights/flight.mcap
dpkg -P nadird >/dev/null 2>&1
test ! -e /var/lib/nadir -a ! -e /etc/nadir/nadird.env || fail "purged, but state or configuration is there"
test -e /var/lib/nadir-flights/flight.mcap -a -e /etc/nadir/keys/link.key || fail "the purge took recordings or keys along"
getent passwd nadir >/dev/null || fail "the purge removed the owner of the recordings"
rm /var/lib/nadir-flights/flight.mcap /etc/nadir/keys/link.key
dpkg --force-depends -i /new.deb >/dev/null 2>&1 && dpkg -P nadird >/dev/null 2>&1
! getent passwd nadir >/dev/null || fail "the user is there after a purge without data"
test ! -e /etc/nadir -a ! -e /var/lib/nadir-flights -a ! -e /var/lib/nadir-packages || fail "folders are left"
'''
# The same of nadir-candidates, which has a unit of its own.
CANDIDATES = r'''
set -e
export PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive
fail() { echo "$*"; exit 1; }
state=/var/lib/nadir-candidate-service
dpkg --force-depends -i /new.deb >/dev/null 2>&1 || fail "cannot be installed"
test "$(stat -c '%U %a' $state)" = "nadir-candidates 750" || fail "no folder for its data"
test ! -e /etc/systemd/system/multi-user.target.wants/nadir-candidates.service || fail "enabled without configuration"
grep -q '^#NADIR_CANDIDATES_OPTIONS=' /etc/nadir-candidates/nadir-candidates.env || fail "no example of its options"
# Tokens as docs/install.md makes them: the service's own user can read them, and nobody else.
setpriv --reuid nadir-candidates --regid nadir-candidates --clear-groups \
  nadir-candidates token create --tokens $state/tokens.json --id ground-1 --out $state/ground-1.token >/dev/null || fail "no token"
test "$(stat -c '%U %a' $state/tokens.json)" = "nadir-candidates 600" || fail "whose tokens are these?"
dpkg -r nadir-candidates >/dev/null 2>&1 && dpkg -P nadir-candidates >/dev/null 2>&1
test -e $state/tokens.json || fail "the purge took data along"
getent passwd nadir-candidates >/dev/null || fail "the purge removed the owner of the data"
test ! -e /etc/nadir-candidates || fail "the configuration is left"
rm -r $state
dpkg --force-depends -i /new.deb >/dev/null 2>&1 && dpkg -P nadir-candidates >/dev/null 2>&1
test ! -e $state || fail "an empty folder is left"
! getent passwd nadir-candidates >/dev/null || fail "the user is there after a purge without data"
'''
OVERLAY = r'''
set -e
mount -t tmpfs -o size=512m none "$1"
mkdir "$1/upper" "$1/work" "$1/root"
mount -t overlay -o lowerdir=/,upperdir="$1/upper",workdir="$1/work" none "$1/root"
'''


def pack(build, folder, epoch, component="nadird"):
    subprocess.run(["cpack", "--config", str(build / "CPackConfig.cmake"), "-D", f"CPACK_COMPONENTS_ALL={component}", "-D", "CPACK_DEBIAN_COMPRESSION_TYPE=gzip", "-B", str(folder)],
                   check=True, capture_output=True, env={**os.environ, "SOURCE_DATE_EPOCH": epoch})
    return next(folder.glob(f"{component}_*.deb"))


def field(deb, name):
    return subprocess.run(["dpkg-deb", "-f", str(deb), name], capture_output=True, text=True, check=True).stdout.strip()


def check_contents(root, build, deb):
    listed = subprocess.run(["dpkg-deb", "-c", str(deb)], capture_output=True, text=True, check=True).stdout
    for path in ("usr/bin/nadird", "lib/systemd/system/nadird.service", "etc/nadir/nadird.env", "usr/share/man/man8/nadird.8.gz",
                 "usr/share/bash-completion/completions/nadird", "usr/share/zsh/vendor-completions/_nadird",
                 "usr/share/fish/vendor_completions.d/nadird.fish", "usr/share/doc/nadird/copyright",
                 "usr/share/doc/nadird/changelog.Debian.gz"):
        if not re.search(rf" \./{re.escape(path)}$", listed, re.M):
            yield f"the package has no {path}"
    if re.search(r"^\S+ (?!root/root)", listed, re.M):
        yield "files that are not root's"
    for word in FORBIDDEN:
        if word in field(deb, "Depends"):
            yield f"nadird depends on {word}"
    newest = re.match(r"nadir \(([^)]*)\)", (root / "cmake/packaging/debian/changelog").read_text())[1]
    if field(deb, "Version") != newest:
        yield f"the version is {field(deb, 'Version')}, of cmake/packaging/debian/changelog {newest}"
    maintainer = re.search(r"^NADIR_MAINTAINER:STRING=(.*)$", (build / "CMakeCache.txt").read_text(), re.M)[1]
    unpacked = subprocess.run(["dpkg-deb", "--fsys-tarfile", str(deb)], capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(unpacked)) as files:
        changelog = gzip.decompress(files.extractfile("./usr/share/doc/nadird/changelog.Debian.gz").read()).decode()
    for place, found in (("Maintainer", field(deb, "Maintainer")), ("changelog", re.search(r"^ -- (.*>)  ", changelog, re.M)[1])):
        if found != maintainer:
            yield f"{place} names {found}; NADIR_MAINTAINER is {maintainer}"


def check_candidates(deb):
    listed = subprocess.run(["dpkg-deb", "-c", str(deb)], capture_output=True, text=True, check=True).stdout
    for path in ("usr/bin/nadir-candidates", "lib/systemd/system/nadir-candidates.service", "etc/nadir-candidates/nadir-candidates.env"):
        if not re.search(rf" \./{re.escape(path)}$", listed, re.M):
            yield f"the package of nadir-candidates has no {path}"


def check_candidates_in_copy(deb, folder):
    """As check_in_copy()."""
    if os.geteuid() != 0:
        return "that takes root"
    mount = folder / "overlay-candidates"
    mount.mkdir()
    script = OVERLAY + r'''
cp "$2" "$1/root/new.deb"
mount --bind /dev "$1/root/dev"; mount -t proc proc "$1/root/proc"
chroot "$1/root" sh -c "dpkg -P --force-all nadir-candidates >/dev/null 2>&1; rm -rf /etc/nadir-candidates /var/lib/nadir-candidate-service; deluser --system --quiet nadir-candidates >/dev/null 2>&1; true"
chroot "$1/root" sh -c "$3"
'''
    result = subprocess.run(["unshare", "-m", "sh", "-c", script, "sh", mount, deb, CANDIDATES], capture_output=True, text=True,
                            timeout=300)
    assert result.returncode == 0, "nadir-candidates: " + result.stdout + result.stderr
    return None


def check_in_copy(deb, folder):
    """None, or why it could not be tried; raises AssertionError with what is wrong."""
    if os.geteuid() != 0:
        return "that takes root"
    mount = folder / "overlay"
    mount.mkdir()
    older = folder / "older"
    subprocess.run(["dpkg-deb", "-R", deb, older], check=True)
    control = older / "DEBIAN/control"
    control.write_text(re.sub(r"^Version: .*", "Version: 0.0.9-1", control.read_text(), flags=re.M))
    with (older / "etc/nadir/nadird.env").open("a") as text:
        text.write("# of 0.0.9\n")
    subprocess.run(["dpkg-deb", "-Znone", "-b", older, folder / "older.deb"], check=True, capture_output=True)
    tried = subprocess.run(["unshare", "-m", "sh", "-c", OVERLAY + 'exit 0', "sh", mount], capture_output=True, text=True)
    if tried.returncode != 0:
        return f"no overlay can be mounted here: {tried.stderr.strip()}"
    script = OVERLAY + r'''
cp "$2" "$1/root/new.deb"; cp "$3" "$1/root/older.deb"
mount --bind /dev "$1/root/dev"; mount -t proc proc "$1/root/proc"
chroot "$1/root" sh -c "dpkg -P --force-all nadird >/dev/null 2>&1; rm -rf /etc/nadir /var/lib/nadir /var/lib/nadir-*; deluser --system --quiet nadir >/dev/null 2>&1; true"
chroot "$1/root" env VERSION="$4" sh -c "$5"
'''
    version = field(deb, "Version").rsplit("-", 1)[0]
    result = subprocess.run(["unshare", "-m", "sh", "-c", script, "sh", mount, deb, folder / "older.deb", version, SCENARIO],
                            capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stdout + result.stderr
    return None


def main():
    root, build = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()
    for tool in ("cpack", "dpkg-shlibdeps", "dpkg-deb", "unshare"):
        if shutil.which(tool) is None:
            print(f"NOT TESTED: Debian packages: {tool} is not installed")
            return 77
    with tempfile.TemporaryDirectory(prefix="nadir-packages.") as name:
        folder = pathlib.Path(name)
        folder.chmod(0o755)
        deb = pack(build, folder / "first", "1795521600")
        again = pack(build, folder / "second", "1795521600")
        candidates = pack(build, folder / "candidates", "1795521600", "nadir-candidates")
        problems = [*check_contents(root, build, deb), *check_candidates(candidates)]
        if deb.read_bytes() != again.read_bytes():
            problems.append("a second build of the package has other bytes")
        if shutil.which("lintian"):
            judged = subprocess.run(["lintian", "--fail-on", "error", str(deb), str(candidates)], capture_output=True, text=True)
            if judged.returncode != 0:
                problems.append(judged.stdout)
        else:
            print("NOT TESTED: lintian's judgement: it is not installed")
        untried = None
        try:
            untried = check_in_copy(deb, folder) or check_candidates_in_copy(candidates, folder)
        except AssertionError as wrong:
            problems.append(str(wrong))
    print("\n".join(problems) if problems else "packages: fine")
    if problems:
        return 1
    if untried:
        print(f"NOT TESTED: installing, upgrading and purging nadird: {untried}")
        return 77
    return 0


if __name__ == "__main__":
    sys.exit(main())
