#!/usr/bin/env bash
# cmake/packaging/check.sh PACKAGES: installs the Debian packages of a folder in a fresh Debian 12, uses them as docs/install.md
# says, upgrades, removes and purges them. Needs root, mmdebstrap, buildah and Debian's mirror; what it makes lies below TMPDIR
# and is removed. NADIR_MIRROR: another mirror.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
packages=$(cd "${1:?usage: cmake/packaging/check.sh PACKAGES}" && pwd)
[[ $(id -u) == 0 ]] || { echo "NOT TESTED: a fresh Debian 12: that takes root" >&2; exit 77; }
for tool in mmdebstrap buildah; do
  command -v "$tool" >/dev/null || { echo "NOT TESTED: a fresh Debian 12: $tool is not installed" >&2; exit 77; }
done

work=$(mktemp -d)
containers() { TMPDIR=$work buildah --root "$work/containers" --runroot "$work/containers-run" --storage-driver vfs "$@"; }
clean_up() {
  umount -q "$work"/*/proc "$work"/*/dev 2>/dev/null || true
  containers rm --all >/dev/null 2>&1 || true
  rm -rf --one-file-system -- "$work"
}
trap clean_up EXIT
fail() { echo "check: $*" >&2; exit 1; }
say() { echo "check: $*"; }
quietly() { "$@" >"$work/log" 2>&1 || { cat "$work/log" >&2; fail "$*"; }; }

mmdebstrap --quiet --variant=apt bookworm "$work/base.tar" "${NADIR_MIRROR:-http://deb.debian.org/debian}"
fresh() { # NAME: a fresh system in $root
  root=$work/$1
  mkdir "$root"
  tar -xf "$work/base.tar" -C "$root" --exclude='./dev/*'
  mount --bind /dev "$root/dev"
  mount -t proc proc "$root/proc"
  cp /etc/resolv.conf "$root/etc/resolv.conf"
  mkdir "$root/packages"
  cp "$packages"/*.deb "$root/packages/"
}
inside() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive "$@"; }
apt() { quietly inside apt-get -qq -y -o Dpkg::Use-Pty=0 --no-install-recommends "$@"; }
installed() { inside dpkg-query -W -f='${Package}\n' | sort; }
listing() { # every file but those of apt, dpkg, logs and locks
  (cd "$root" && find . -xdev \( -path ./var/lib/dpkg -o -path ./var/lib/apt -o -path ./var/cache -o -path ./var/log -o -path ./packages -o -path ./run \
    -o -path ./dev -o -path ./proc -o -name '*-' -path './etc/*' \) -prune -o -printf '%p\n' | LC_ALL=C sort)
}

# --- nadird -------------------------------------------------------------------------------------------------------------
fresh nadird
apt update
installed >"$work/before"
listing >"$work/files-before"

# An older version first, so that there is an upgrade.
new=$(echo "$packages"/nadird_*.deb)
version=$(dpkg-deb -f "$new" Version)
dpkg-deb -R "$new" "$work/older"
sed -i 's/^Version: .*/Version: 0.0.9-1/' "$work/older/DEBIAN/control"
echo '# of 0.0.9' >>"$work/older/etc/nadir/nadird.env"
dpkg-deb -b "$work/older" "$root/packages/older.deb" >/dev/null
apt install /packages/older.deb
[[ $(inside stat -c '%U %a' /var/lib/nadir-flights) == "nadir 750" ]] || fail "no folder for recordings"
[[ $(inside stat -c '%U %a' /etc/nadir/keys) == "root 700" ]] || fail "/etc/nadir/keys is not root's alone"
inside test ! -e /etc/systemd/system/multi-user.target.wants/nadird.service || fail "nadird is enabled without configuration"
inside install -d -o nadir -g nadir /var/lib/nadir
inside sh -c 'echo memory >/var/lib/nadir/aircraft.json; echo "NADIRD_OPTIONS=--help" >>/etc/nadir/nadird.env; echo secret >/etc/nadir/keys/link.key'

apt -o Dpkg::Options::=--force-confold install "/packages/${new##*/}"
[[ $(inside nadird --version) == "nadird ${version%-*}" ]] || fail "nadird --version: $(inside nadird --version)"
inside grep -q NADIRD_OPTIONS=--help /etc/nadir/nadird.env || fail "the upgrade lost the operator's configuration"
inside test -e /var/lib/nadir/aircraft.json || fail "the upgrade lost the state"
[[ $(inside nadird --check 2>&1 >/dev/null || echo "code $?") == *"--package PACKAGE is required"*"code 2" ]] || fail "nadird --check without a package"
added=$(comm -13 "$work/before" <(installed) | grep -vx nadird)
say "nadird installs $(wc -l <<<"$added") packages with it: $(tr '\n' ' ' <<<"$added")"
# shellcheck disable=SC2086
say "$(inside dpkg-query -W -f='${Installed-Size}\n' nadird $added | awk '{kib += $1} END {printf "%.0f MiB in all", kib / 1024}'), $(inside ldd /usr/bin/nadird | wc -l) libraries loaded"
inside ldd /usr/bin/nadird | grep -E 'not found|gdal|libproj|libcurl' && fail "nadird loads what it must not"
if command -v systemd-analyze >/dev/null; then
  judged=$(systemd-analyze security --offline=yes --root="$root" --no-pager --threshold=17 nadird.service | tail -n 1) || fail "exposure: $judged"
  say "systemd: $judged"
else
  say "NOT TESTED: the unit's exposure: systemd-analyze is not here"
fi

apt remove nadird
inside test ! -e /usr/bin/nadird || fail "removed, but the program is still there"
inside test -e /var/lib/nadir/aircraft.json -a -e /etc/nadir/nadird.env || fail "removing took state or configuration along"
inside touch /var/lib/nadir-flights/flight.mcap
apt purge nadird
inside test ! -e /var/lib/nadir -a ! -e /etc/nadir/nadird.env || fail "purged, but state or configuration is still there"
inside test -e /var/lib/nadir-flights/flight.mcap -a -e /etc/nadir/keys/link.key || fail "the purge took recordings or keys along"
inside getent passwd nadir >/dev/null || fail "the purge removed the owner of the recordings"
# Without data there is nothing to keep.
inside rm /var/lib/nadir-flights/flight.mcap /etc/nadir/keys/link.key
apt install "/packages/${new##*/}"
apt purge nadird
inside getent passwd nadir >/dev/null && fail "the user is still there after a purge without data"
apt autoremove --purge
left=$(comm -13 "$work/files-before" <(listing))
[[ -z $left ]] || fail "left behind by a purge: $left"
say "nadird: installed, upgraded, removed, purged; no file is left"

# --- nadir-candidates ---------------------------------------------------------------------------------------------------
fresh candidates
apt update
candidates=$(echo "$packages"/nadir-candidates_*.deb)
apt install "/packages/${candidates##*/}"
[[ $(inside stat -c '%U %a' /var/lib/nadir-candidate-service) == "nadir-candidates 750" ]] || fail "no folder for the candidate service"
inside test ! -e /etc/systemd/system/multi-user.target.wants/nadir-candidates.service || fail "nadir-candidates is enabled without configuration"
inside runuser -u nadir-candidates -- nadir-candidates token create --tokens /var/lib/nadir-candidate-service/tokens.json --id ground-1 \
  --out /var/lib/nadir-candidate-service/ground-1.token >/dev/null || fail "its user cannot make a token"
if command -v systemd-analyze >/dev/null; then
  judged=$(systemd-analyze security --offline=yes --root="$root" --no-pager --threshold=11 nadir-candidates.service | tail -n 1) || fail "exposure: $judged"
  say "systemd: $judged"
fi
apt purge nadir-candidates
inside test -e /var/lib/nadir-candidate-service/tokens.json -a ! -e /etc/nadir-candidates || fail "purged: data gone, or configuration left"
say "nadir-candidates: installed and purged; its data is left"

# --- the images: built by their Dockerfiles, upon this fresh Debian as debian:12-slim, and started by their entry points ------
base=$(containers from scratch)
quietly containers add "$base" "$work/base.tar" /
quietly containers commit --rm "$base" docker.io/library/debian:12-slim
image() { # NAME: the image of cmake/packaging/docker/NAME.Dockerfile, and a container of it in $container, its files in $root
  quietly containers build --isolation chroot --pull-never -f "$here/docker/$1.Dockerfile" -t "$1" "$packages"
  container=$(containers from --pull-never "$1")
  root=$(containers mount "$container")
}
in_container() { containers run --isolation chroot "$container" -- "$@"; } # as its user
started() { # WORD...: the container's entry point
  local entry
  mapfile -t entry < <(containers inspect --format '{{range .OCIv1.Config.Entrypoint}}{{println .}}{{end}}' "$container" | sed '/^$/d')
  in_container "${entry[@]}" "$@"
}
image nadir
[[ $(started --version) == nadir* ]] || fail "the image of nadir does not run"
say "image of nadir: $(du -sxm "$root" | cut -f1) MiB"
for plugin in "$packages"/nadir-network-onnxruntime_*.deb; do
  [[ -e $plugin ]] || continue
  cp "$plugin" "$root/tmp/plugin.deb"
  quietly in_container sh -c 'apt-get update && apt-get install -y --no-install-recommends /tmp/plugin.deb'
  in_container ldd /usr/lib/nadir/nadir_network_onnxruntime.so | grep 'not found' && fail "the plug-in of networks lacks a library"
done

# --- planner and aircraft together: a package is built, signed, and accepted by nadird --check ----------------------------
in_container sh -ec "
  cd /srv
  nadir simulate world --seed 7 --size-km 1 --gsd-m 0.5 --out world >/dev/null
  nadir keys create --out signer >/dev/null && nadir keys create --out root >/dev/null
  nadir keys root --root-key root.key.pem --package-signer signer.pub.pem --expires 2035-01-01 --out root.json >/dev/null
  nadir cache build --mission world/mission.yaml --imagery world/map.tif --dem world/dem.tif --key signer.key.pem --trust root.json --out package >/dev/null" || fail "nadir does not build a package"
day=$(sed -n 's/^created: *"\?\([0-9-]*\).*/\1/p' "$root/srv/world/mission.yaml")
cp -r "$root/srv/package" "$root/srv/root.json" "$work/"
image nadird
[[ $(started --version) == nadird* ]] || fail "the image of nadird does not run"
say "image of nadird: $(du -sxm "$root" | cut -f1) MiB"
cp -r "$work/package" "$work/root.json" "$root/srv/"
started --at "$day" --package /srv/package --trust /srv/root.json --check || fail "nadird --check rejects it"
say "a package that the image of nadir builds passes nadird --check in the image of nadird"
