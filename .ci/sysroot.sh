#!/usr/bin/env bash
# .ci/sysroot.sh FOLDER: Debian 12's arm64 headers and libraries, which the cross compiler and qemu read. Made when it is missing or
# when the list of packages has changed since; otherwise nothing happens and no network is needed. Nothing is installed on
# this machine: the packages are unpacked, without their scripts. NADIR_MIRROR: another mirror. Exit code 2: it could not be made.
set -euo pipefail
folder=$(realpath -m "${1:?usage: .ci/sysroot.sh FOLDER}")
here=$(dirname "${BASH_SOURCE[0]}")
. "$here/packages.sh"
fail() { echo "sysroot: $*" >&2; exit 2; }

# The libraries of the build; its tools stay the machine's own.
packages=$(printf '%s\n' libc6-dev libgomp1 "${packages_build[@]}" "${packages_package[@]}" |
  grep -E '^(lib.*|nlohmann-json3-dev|zlib1g-dev)$' | sort -u | paste -sd,)
made_from="$folder: $packages"
exec 9<"$here/packages.sh"
flock 9
[[ $(cat "$folder/made-from" 2>/dev/null) != "$made_from" ]] || exit 0

command -v mmdebstrap >/dev/null || fail "mmdebstrap is not installed; to do: apt-get install mmdebstrap"
echo "sysroot: making $folder from Debian's arm64 packages (some 290 MB to download)" >&2
rm -rf "$folder"
mkdir -p "$folder"
mmdebstrap --quiet --variant=extract --architectures=arm64 --skip=check/qemu,cleanup/apt/cache \
  --hook-dir=/usr/share/mmdebstrap/hooks/merged-usr --include="$packages" bookworm - ${NADIR_MIRROR:+"$NADIR_MIRROR"} |
  tar -x -C "$folder" --no-same-owner --exclude='./dev' || fail "the packages could not be unpacked (see above)"

# What the packages' scripts would have done: Debian's choice among the implementations of BLAS and LAPACK, and links that lead
# into the sysroot and not into this machine.
libraries=$folder/usr/lib/aarch64-linux-gnu
for library in "$libraries"/atlas/*.so*; do
  ln -s "atlas/${library##*/}" "$libraries/${library##*/}"
done
while IFS=$'\t' read -r link target; do
  ln -sfn "$(realpath -m --relative-to="$(dirname "$link")" "$folder/$target")" "$link"
done < <(find "$folder/usr" -type l -lname '/*' -printf '%p\t%l\n')
# PROJ accepts only cross compilers when it was itself compiled by one; Debian's was not.
sed -i 's/(CMAKE_CROSSCOMPILING_STR "ON")/(CMAKE_CROSSCOMPILING_STR "OFF")/' "$libraries"/cmake/proj*/proj*-config-version.cmake
# FAISS and Ceres name libraries by their place on the machine that they were compiled on.
sed -i '/INTERFACE_LINK_LIBRARIES/s,\([;"]\)/usr/lib/,\1${_IMPORT_PREFIX}/lib/,g' "$libraries"/cmake/*/*[tT]argets.cmake

# dpkg's database, from which dpkg-shlibdeps takes the packages that the programs need: of the files where they lie here.
info=$folder/var/lib/dpkg/info
control=$(mktemp -d)
trap 'rm -rf -- "$control"' EXIT
for archive in "$folder"/var/cache/apt/archives/*.deb; do
  rm -rf "$control"
  dpkg-deb -e "$archive" "$control"
  name=$(dpkg-deb -f "$archive" Package)
  [[ $(dpkg-deb -f "$archive" Multi-Arch) != same ]] || name+=:arm64
  for file in shlibs symbols; do
    [[ ! -e $control/$file ]] || cp "$control/$file" "$info/$name.$file"
  done
  dpkg-deb --fsys-tarfile "$archive" | tar -t | sed -e "s,^\.,$folder," -e 's,/$,,' >"$info/$name.list"
  { echo 'Status: install ok installed'; cat "$control/control"; echo; } >>"$folder/var/lib/dpkg/status"
done
rm -rf "$folder"/var/cache/apt/archives/*.deb
echo "$made_from" >"$folder/made-from"
