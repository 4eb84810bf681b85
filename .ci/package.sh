#!/usr/bin/env bash
# ./run package [--check]: Debian packages and their SBOMs in build/packages (docs/install.md). --check also builds them a
# second time and compares the bytes, lets lintian judge them, and installs, configures, upgrades and purges them in a
# fresh Debian 12 that mmdebstrap makes (root, network).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
packages=build/packages
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(dpkg-parsechangelog -l cmake/packaging/debian/changelog -STimestamp)}
export TZ=UTC LC_ALL=C.UTF-8
umask 022

pack() { # FOLDER
  local log
  log=$(mktemp)
  cpack --config build/CPackConfig.cmake -B "$1" >"$log" 2>&1 || { cat "$log" >&2; rm -f "$log"; return 2; }
  rm -rf "$log" "$1/_CPack_Packages"
}

cmake --build build --target nadir_pages -- --quiet
rm -rf "$packages"
pack "$packages"
python3 -B cmake/packaging/sbom.py build "$packages"
(cd "$packages" && sha256sum -- *.deb *.spdx.json >SHA256SUMS && cat SHA256SUMS)
[[ ${1:-} == --check ]] || exit 0

again=$(mktemp -d)
trap 'rm -rf -- "$again"' EXIT
pack "$again"
for package in "$packages"/*.deb; do
  cmp "$package" "$again/${package##*/}" || { echo "package: a second build of ${package##*/} has other bytes" >&2; exit 1; }
done
echo "package: a second build has the same bytes"
lintian --fail-on error --tag-display-limit 0 "$packages"/*.deb
cmake/packaging/check.sh "$packages"
