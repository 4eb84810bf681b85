#!/usr/bin/env bash
# ./run fuzz [SECONDS] [TARGET…]: libFuzzer over the readers of untrusted bytes (tests/fuzz), one after the other. Inputs
# that reach new code collect in build-fuzz/corpus/TARGET, what broke a reader in build-fuzz/found/TARGET; both are worth
# a place in tests/fuzz/corpus, which every build replays.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
seconds=300
if [[ ${1:-} =~ ^[0-9]+$ ]]; then seconds=$1; shift; fi
targets=("$@")
[[ ${#targets[@]} -gt 0 ]] || mapfile -t targets < <(sed -nE 's/^void ([a-z_]+)\(.*/\1/p' tests/fuzz/targets.hpp)

cmake -G Ninja -B build-fuzz -DCMAKE_C_COMPILER=clang-19 -DCMAKE_CXX_COMPILER=clang++-19 \
  -DCMAKE_BUILD_TYPE=RelWithDebInfo -DNADIR_FUZZ=ON >/dev/null
cmake --build build-fuzz --target "${targets[@]/#/fuzz_}"

# Readers that take paths write a file for each input: into memory, where there is such a place.
[[ -w /dev/shm ]] && export TMPDIR=/dev/shm
broken=()
for target in "${targets[@]}"; do
  mkdir -p "build-fuzz/corpus/$target" "build-fuzz/found/$target"
  echo "== $target, $seconds s"
  log=build-fuzz/found/$target.log
  if build-fuzz/bin/"fuzz_$target" -max_total_time="$seconds" -timeout=20 -rss_limit_mb=2048 -max_len=8192 \
    -print_final_stats=1 -artifact_prefix="build-fuzz/found/$target/" "build-fuzz/corpus/$target" \
    "tests/fuzz/corpus/$target" >"$log" 2>&1; then
    grep -E 'number_of_executed_units' "$log"
  else
    broken+=("$target")
    tail -n 40 "$log"
  fi
done
[[ ${#broken[@]} -eq 0 ]] || { echo "found something in: ${broken[*]} (see build-fuzz/found)" >&2; exit 1; }
