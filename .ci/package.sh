#!/usr/bin/env bash
# ./run package [--check]: Debian packages and their SBOMs in build/packages (docs/install.md), or build-arm64/packages. --check also builds them a
# second time and compares the bytes, lets lintian judge them, and installs, configures, upgrades and purges them in a
# fresh Debian 12 that mmdebstrap makes (root, network), on which buildah builds the images.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. .ci/build.sh
packages=$build_folder/packages
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(dpkg-parsechangelog -l cmake/packaging/debian/changelog -STimestamp)}
export TZ=UTC LC_ALL=C.UTF-8
umask 022

pack() { # FOLDER
  local log
  log=$(mktemp)
  cpack --config "$build_folder/CPackConfig.cmake" -B "$1" >"$log" 2>&1 || { cat "$log" >&2; rm -f "$log"; return 2; }
  rm -rf "$log" "$1/_CPack_Packages"
}

if [[ $preset == arm64 ]]; then # the libraries and their packages are those of the sysroot
  [[ ${1:-} != --check ]] || { echo "package: --check installs the packages here: not those for arm64" >&2; exit 2; }
  export DEB_HOST_ARCH=arm64 DPKG_ADMINDIR=$PWD/build-arm64-sysroot/var/lib/dpkg
fi
cmake --build "$build_folder" --target nadir_installed -- --quiet
rm -rf "$packages"
pack "$packages"
python3 -B cmake/packaging/sbom.py "$build_folder" "$packages"
(cd "$packages" && sha256sum -- *.deb *.spdx.json >SHA256SUMS && cat SHA256SUMS)
[[ ${1:-} == --check ]] || exit 0

# Beside the first: CPack counts the sizes of folders, which file systems state differently, in Installed-Size.
again=$(mktemp -d "$PWD/$build_folder/packages-again.XXXXXX")
trap 'rm -rf -- "$again"' EXIT
pack "$again"
for package in "$packages"/*.deb; do
  cmp "$package" "$again/${package##*/}" || { echo "package: a second build of ${package##*/} has other bytes" >&2; exit 1; }
done
echo "package: a second build has the same bytes"
lintian --fail-on error --tag-display-limit 0 "$packages"/*.deb
cmake/packaging/check.sh "$packages"
