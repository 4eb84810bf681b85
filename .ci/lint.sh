#!/usr/bin/env bash
# Formatting and clang-tidy over our own sources. Arguments: files, or everything that git knows.
set -uo pipefail
if [[ $# -gt 0 ]]; then files=("$@"); else mapfile -t files < <(git ls-files '*.cpp' '*.hpp'); fi
failed=0
clang-format --dry-run --Werror "${files[@]}" || failed=1
mapfile -t sources < <(printf '%s\n' "${files[@]}" | grep '\.cpp$')
# Each source by itself, as clang-tidy looks at it, with the headers that a build makes.
cmake -G Ninja -B build/lint -DCMAKE_BUILD_TYPE=Release -DNADIR_UNITY=OFF >/dev/null &&
  cmake --build build/lint --target nadir_mavlink_headers_generated >/dev/null || exit 2
# gcc's precompiled headers are no use to clang: it reads the sources without them.
python3 - build/lint/compile_commands.json <<'P' || exit 2
import json, os, re, sys
commands = json.load(open(sys.argv[1]))
for entry in commands:
    entry["command"] = re.sub(r"-include \S*cmake_pch\.hxx|-Winvalid-pch|-Wduplicated-cond|-Wlogical-op|-Wno-stringop-overflow|-Wno-maybe-uninitialized|-Wno-restrict|-Wno-subobject-linkage|--param \S+", "", entry["command"])
json.dump(commands, open("build/lint/compile_commands.json", "w"))
P
printf '%s\0' "${sources[@]}" | xargs -0 -n 4 -P "$(nproc)" clang-tidy-19 --quiet -p build/lint || failed=1
if [[ $failed == 0 ]]; then echo "lint: clean"; else echo "lint: see above" >&2; fi
exit $failed
