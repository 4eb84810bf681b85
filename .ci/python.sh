#!/usr/bin/env bash
# .ci/python.sh FOLDER: the Python environment of the build and of the tests. Made when it is missing or when
# python-requirements.txt has changed since; otherwise nothing happens and no network is needed. CMake calls it, so that
# `cmake --preset release` works as `./run build` does. Exit code 2: it could not be made.
set -euo pipefail
folder=${1:?usage: .ci/python.sh FOLDER}
requirements=$(dirname "${BASH_SOURCE[0]}")/python-requirements.txt
mkdir -p "$(dirname "$folder")"
exec 9<"$requirements"
flock 9
cmp -s "$requirements" "$folder/made-from" && exit 0

echo "python: making $folder from $requirements" >&2
rm -rf "$folder"
python3 -m venv "$folder" >&2 || {
  rm -rf "$folder"
  echo "python: cannot make a virtual environment; to do: apt-get install python3-venv" >&2
  exit 2
}
# --no-deps: the list names all that is needed.
"$folder/bin/pip" install --quiet --disable-pip-version-check --prefer-binary --no-deps -r "$requirements" >&2 || {
  rm -rf "$folder"
  cat >&2 <<TEXT
python: the packages of $requirements could not be installed (see above).
  They are fetched from PyPI once; later builds need no network. Without network now:
    - PIP_INDEX_URL=URL or PIP_NO_INDEX=1 PIP_FIND_LINKS=FOLDER of a mirror that holds them, or
    - copy the folder $(basename "$folder")/ from a checkout at the same path that was built before.
TEXT
  exit 2
}
cp "$requirements" "$folder/made-from"
