# Configure, compile, test. Sourced by ./run.

preset=${NADIR_PRESET:-release}
build_folder=build
[[ $preset == release ]] || build_folder=build-$preset

configure() {
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

run_tests() {
  # ThreadSanitizer takes the pool of OpenMP, which was not built with it, for races.
  [[ $preset != tsan ]] || export OMP_NUM_THREADS=1
  # One more than cores: some tests wait for clocks, sockets and servers.
  local status=0
  ctest --test-dir "$build_folder" --output-on-failure -j "$(($(nproc) + 1))" "$@" </dev/null || status=$?
  # ctest names what it skipped; this is why.
  grep -hE '^(NOT TESTED|SKIPPED): ' "$build_folder/Testing/Temporary/LastTest.log" | sort -u >&2 || true
  return "$status"
}
