#!/usr/bin/env bash
# .ci/onnxruntime.sh FOLDER: the header of ONNX Runtime's C interface, which the network plug-in is compiled with. Debian 12 has no
# package of it, Debian 13 has: its libonnxruntime-dev (85 kB) is fetched by apt, which verifies Debian's signatures, and unpacked into
# FOLDER; nothing is installed on this machine. Made when it is missing; otherwise nothing happens and no network is needed.
# NADIR_MIRROR: another mirror. Exit code 2: it could not be made; the build does without the plug-in then.
set -euo pipefail
folder=$(realpath -m "${1:?usage: .ci/onnxruntime.sh FOLDER}")
version=1.21.0+dfsg-1
sha256=14f7d959d5deacbcf1504830d4189f91fc67382b399ed9ae9d3aa9c4050ced08
fail() { echo "onnxruntime: $*" >&2; exit 2; }

exec 9<"${BASH_SOURCE[0]}"
flock 9
[[ $(cat "$folder/made-from" 2>/dev/null) != "$sha256" ]] || exit 0
command -v apt-get >/dev/null || fail "this is no Debian machine"
mirror=${NADIR_MIRROR:-$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 2>/dev/null | grep -m1 '/debian/$' || true)}
[[ -n $mirror ]] || fail "apt knows no mirror of Debian; name one by NADIR_MIRROR"

scratch=$(mktemp -d)
trap 'rm -rf -- "$scratch"' EXIT
mkdir -p "$scratch"/{lists,archives}/partial
echo "deb $mirror trixie main" >"$scratch/sources.list"
options=(-qq -o "Dir::State::lists=$scratch/lists" -o "Dir::Etc::sourcelist=$scratch/sources.list" -o Dir::Etc::sourceparts=-
         -o "Dir::Cache=$scratch" -o Acquire::Languages=none -o Acquire::IndexTargets::deb::DEP-11::DefaultEnabled=false
         -o APT::Sandbox::User=root -o APT::Architecture=amd64 -o APT::Architectures=amd64)
cd "$scratch"
apt-get "${options[@]}" update >&2 && apt-get "${options[@]}" download "libonnxruntime-dev=$version" >&2 ||
  fail "libonnxruntime-dev $version of Debian 13 could not be fetched (see above)"
echo "$sha256  $(echo libonnxruntime-dev_*.deb)" | sha256sum --check --quiet >&2 || fail "libonnxruntime-dev is not the one that was chosen"
rm -rf "$folder"
mkdir -p "$folder"
dpkg-deb -x libonnxruntime-dev_*.deb "$folder"
echo "$sha256" >"$folder/made-from"
