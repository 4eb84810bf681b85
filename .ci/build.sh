# Configure, compile, test. Sourced by ./run.

preset=${NADIR_PRESET:-release}
build_folder=build
[[ $preset == release ]] || build_folder=build-$preset

# What this build needs beyond packages_build.
packages_of_preset=()
[[ $preset != arm64 ]] || packages_of_preset=(arm64)

configure() {
  [[ $preset != arm64 ]] || .ci/sysroot.sh build-arm64-sysroot || return
  local log
  log=$(mktemp)
  if ! cmake --preset "$preset" >"$log" 2>&1; then
    cat "$log" >&2; rm -f "$log"
    return 2
  fi
  rm -f "$log"
}

# build [TARGET…]: those alone, or everything. Ninja says how many steps are done, of how many, and for how long it has
# been at it.
build() {
  configure || return
  local targets=()
  [[ $# -eq 0 ]] || targets=(--target "$@")
  NINJA_STATUS='[%f/%t, %e s] ' cmake --build "$build_folder" "${targets[@]}"
}

# What `./run demo` runs: the programs, no tests.
build_programs() {
  build nadir nadird nadir-candidates
}

# A folder in memory for the tests' files, when there is room: most of what tests wait for is fsync on a disk.
# Nothing is printed when there is none; TMPDIR of the caller wins.
memory_folder() {
  [[ -z ${TMPDIR:-} && -w /dev/shm ]] || return 0
  local free_mib available_mib
  free_mib=$(df --output=avail -BM /dev/shm | tail -1 | tr -dc 0-9)
  available_mib=$(awk '/^MemAvailable:/ {print int($2 / 1024)}' /proc/meminfo)
  ((free_mib >= 6000 && available_mib >= 12000)) || return 0
  local folder
  folder=$(mktemp -d /dev/shm/nadir-tests-XXXXXX) && chmod 1777 "$folder" && echo "$folder"  # PostgreSQL is another user
}

run_tests() {
  # ThreadSanitizer takes the pool of OpenMP, which was not built with it, for races.
  [[ $preset != tsan ]] || export OMP_NUM_THREADS=1
  # Some tests preload a clock or a fault into the programs, before the sanitizer's library.
  [[ $preset != asan ]] || export ASAN_OPTIONS=${ASAN_OPTIONS:-verify_asan_link_order=0}
  # Two more than cores: some tests wait for clocks, sockets and servers.
  local status=0 scratch
  scratch=$(memory_folder)
  [[ -z $scratch ]] || { export TMPDIR=$scratch; trap 'rm -rf -- "$TMPDIR"' EXIT; }
  ctest --test-dir "$build_folder" --output-on-failure -j "$(($(nproc) + 2))" "$@" </dev/null || status=$?
  # ctest names what it skipped; this is why.
  grep -hE '^(NOT TESTED|SKIPPED): ' "$build_folder/Testing/Temporary/LastTest.log" | sort -u >&2 || true
  return "$status"
}
