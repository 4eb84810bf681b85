#!/usr/bin/env bash
# Figures against the tools that a user would choose instead, run side by side. docs/benchmarks.md describes each part
# and its latest results. Ratios count, not seconds: machines differ.
#
# usage: ./run bench [PART [OPTIONS]]
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
cd "$here/../.."
[[ -z ${NADIR_BENCH_VENV:-} ]] || PATH=$PATH:$NADIR_BENCH_VENV/bin

usage() {
  cat <<'TEXT'
usage: ./run bench [PART [OPTIONS]]     OPTIONS: ./run bench PART --help

  build         what a clean build costs: CPU seconds by folder, slowest units (--against COMMIT; 20 minutes)
  suite         what the tests cost: CPU seconds of each test that ctest knows, by folder (-R REGEX, --against FILE; 20 minutes)
  arm64         the cross build under qemu: tests, bytes beside this machine's own build, instructions per frame (--quick; ten minutes)
  package       tile sets from one picture: Nadir, gdal_translate + gdaladdo, gdal2tiles.py, rio-mbtiles, rio-cogeo
  validators    what validators say about damaged tile sets and about Nadir's own
  export        a package's imagery for other programs: size, time and memory of each format (a minute)
  patch         bytes on the wire for a map of which 2 % have changed: a patch, rsync, xdelta3, zstd (a minute; --format cog)
  kill          builds and resumes killed at random moments
  area          20 km² at zoom 19: built, verified in full, indexed, read tile by tile (15 minutes)
  scale         a build shared by 1, 2, 4 and 8 shards on this machine's cores: seconds, memory, the same bytes (5 minutes)
  large         100 000 tiles, 10 GB: quick and full verification, coverage and freshness, catalogue (10 minutes, 11 GB)
  candidates    the candidate service: 100 000 tiles of two flights, in both catalogues, and by several workers (half an hour; --tiles N,
                --only file|server|workers, --against PROGRAM of another commit)
  localization  a flight of sixty frames over a landscape of another day
  latency       the CPU time of a frame, stage by stage, over a simulated flight
  ablations     the method with steps left out and with other backends (--data DIR: over a recorded flight)
  safety        10 000 short flights under faults: how often is a position wrong with confidence? (hours; --resume FILE, --matcher-model FILE)
  flights       long flights with turns, outliers, blackouts, wrong height and heading, at night, over an old map (--resume FILE,
                --matcher-model FILE; half an hour)
  navigability  where a flight would anchor, predicted and flown, over simulated worlds (ten minutes; --seeds FIRST LAST, --fit)
  turns         how far off what odometry says of a turn is (two minutes)
  dark          odometry of two frames at night: steps measured, how far off, made up (two minutes; --pairs N, --seed N)
  consistency   is the flight filter as far off as it says? NEES and NIS of drawn flights
  gps           honest and spoofed GPS beside vision: false alarms an hour, how far off a lie gets (--flights 0: without pictures, a
                minute; with them 10 minutes)
  blind         the camera goes blind for 15 to 60 s: how far off, with an inertial sensor and without (a minute; --flights N)
  shutter       flights by a rolling shutter, undone and ignored (three minutes; --seeds N, --readout-ms MS, --speed-mps V)
  smoothing     a flight log smoothed by the filter, and by a batch in Ceres
  desk          stored flights and the desk: creating one, a batch of pictures, a frame, its event, an object's place, resuming (two minutes)
  segments      floating segments placed as wholes: right, wrongly, how far off; with the land on the map and without (SEEDS [FIRST [ROWS]]; 20 minutes)
  large-desk    3000 pictures of 26 megapixels through nadir desk serve: memory, throughput, disk (FOLDER; --frames N; twenty minutes, 11 GB)
  large-flight  a stored flight of 3000 pictures of 26 megapixels: memory, time, drift (FOLDER [FRAMES]; half an hour, 14 GB)
  adjusted      flights from pictures, adjusted as a whole: photos of shared/data and simulated ones (15 minutes; --only NAME, --seeds N)
  adjustment    block adjustment of a drawn survey: 3000 frames, 200 000 observations (two minutes; --frames N)
  survey        a simulated survey: positions by nadir replay --adjust and by COLMAP's mapper (ten minutes; needs colmap, python3-numpy)
  closed-loop   an autopilot that flies by nadird's fixes over a simulated world, in real time (11 minutes; --scenario NAME)
  chaos         the same under faults, in five parts (25 minutes; --only PART). kill: nadird killed every 30 s; faults: disk full, link
                cut, clocks set, tiles spoilt; restarts: on a full state disk, a taken port, a wrong clock, a torn file, a swapped
                package; intruder: a second sender on the link; tiles: the tile file corrupted and cut off
  attacks       attacks on the built programs, by attacker: what each gets for an answer (five minutes; --list, --only NAME, --json FILE)
  rules         every rule of docs/onboard.md in real time: eight short flights, what was seen and when (9 minutes; --only NAME)
  sitl          ArduPlane itself, in its own simulator, by nadird's fixes (--arduplane PATH; NOT RUN without; 6 minutes)
  px4           PX4 itself, likewise (--px4 PATH; NOT RUN without; 7 minutes)
  mavproxy      MAVProxy itself as a ground station of a simulated flight: heartbeat, figures, hints (NOT RUN without; 2 minutes)
  soak          two hours of simulated flight at eight times real time: memory, file handles, threads
  sync          10 000 tiles uploaded over breaking lines, through every fault and 60 kills; and curl, rsync (5 minutes)
  contract      a client generated from the upload's OpenAPI file sends a batch (NADIR_BENCH_VENV with openapi-python-client)
  tiles         where the tiles lie that simulated flights make (--resume FILE; half an hour)
  ortho         frames with their poses through Nadir and through Orthority: the same place, and at what cost
  looks         labelled looks at maps of painted and real ground (--resume FILE; seeds below 1000 train, from 1000000 on judge;
                --matchability FILE: how often they find their place, by the matchability of the ground)
  retrieval     place retrieval over real imagery of two dates, headings unknown, for every descriptor (--queries N; five minutes)
  integrity     looks that cannot be right, on unseen seeds and imagery, and misleading positions under faults (--part PART --resume FILE; hours)
  own-network   a descriptor network of our own, trained and judged against oriented gradients (train DATA --out FILE; judge FILE...; needs PyTorch)
  matchers      map matchers side by side at the same looks: right, clean, CPU time, how far two err together, knock-outs (MODEL.onnx; an
                hour; --write counts the table of a second matcher)
  fit-likelihood  the likelihood ratio of a look, fitted to such looks and written as a table (--looks FILE...)

Without PART: package, validators, kill and localization with small inputs (5 minutes).
NADIR_BENCH_VENV=DIR: a Python virtual environment with rio-mbtiles and rio-cogeo. mbtiles and pmtiles are taken from
PATH. What is missing says NOT RUN.
TEXT
}

programs() { # the ones that nothing but a bench needs
  cmake --build build --target bench_programs -- --quiet
}

one_program() {
  cmake --build build --target "$1" -- --quiet
}

desk() {
  local folder
  folder=$(mktemp -d)
  echo "| the library of stored flights                  |              | bar        |"
  build/bin/bench_desk "${1:-$folder/desk}"
  rmdir "$folder"
  echo "| nadir desk serve, over HTTP                    |              | bar        |"
  python3 -B "$here/desk_service.py" build/bin/nadir
}

with_bench_python() { # SCRIPT ARGUMENTS…: that needs packages which the build's Python does not have
  local python=python3
  [[ -z ${NADIR_BENCH_VENV:-} ]] || python=$NADIR_BENCH_VENV/bin/python
  "$python" -B "$@"
}

part() {
  local name=$1
  shift
  echo "== $name"
  case $name in
    build)        python3 "$here/build.py" "$@" ;;
    suite)        python3 -B "$here/suite.py" "$@" ;;
    arm64)        one_program nadir && python3 -B "$here/arm64.py" "$@" ;;
    package)      programs && python3 "$here/package.py" "$@" ;;
    validators)   python3 "$here/validators.py" "$@" ;;
    export)       one_program nadir && python3 -B "$here/export.py" "$@" ;;
    patch)        one_program nadir && python3 -B "$here/patch.py" "$@" ;;
    kill)         python3 "$here/kill_resume.py" "$@" ;;
    scale)        one_program nadir && build-venv/bin/python -B "$here/scale.py" "$@" ;;
    navigability) one_program nadir && python3 -B "$here/navigability.py" build/bin "$@" ;;
    area)         programs && python3 "$here/area.py" "$@" ;;
    large)        programs && python3 "$here/large.py" "$@" ;;
    candidates)   one_program make_flights && one_program nadir-candidates && python3 -B "$here/candidates.py" "$@" ;;
    localization) "$here/localization.sh" "$@" ;;
    latency)      one_program bench_stages && one_program bench_cold_start && "$here/latency.sh" "$@" ;;
    ablations)    one_program bench_ablations && "$here/ablations.sh" "$@" ;;
    safety)       one_program bench_safety && build/bin/bench_safety "$@" ;;
    flights)      one_program bench_flights && build/bin/bench_flights "$@" ;;
    consistency)  one_program bench_consistency && build/bin/bench_consistency "$@" ;;
    gps)          one_program bench_gps && build/bin/bench_gps "$@" ;;
    blind)        one_program bench_blind && build/bin/bench_blind "$@" ;;
    turns)        one_program bench_turns && build/bin/bench_turns "$@" ;;
    dark)         one_program bench_dark && build/bin/bench_dark "$@" ;;
    shutter)      one_program nadir && python3 -B "$here/shutter.py" "$@" ;;
    smoothing)    one_program bench_smoothing && build/bin/bench_smoothing "$@" ;;
    desk)         one_program bench_desk && desk "$@" ;;
    segments)     one_program bench_segments && build/bin/bench_segments "$@" ;;
    large-desk)   one_program nadir && python3 -B "$here/large_desk.py" build/bin/nadir "$@" ;;
    large-flight) one_program bench_large_flight && build/bin/bench_large_flight "$@" ;;
    adjusted)     one_program nadir && one_program bench_adjusted_flight && one_program bench_mosaic && python3 -B "$here/adjusted.py" build "$@" ;;
    adjustment)   one_program bench_adjustment && build/bin/bench_adjustment "$@" ;;
    own-network)  with_bench_python "$here/own_network.py" "$@" ;;
    survey)       one_program nadir && with_bench_python "$here/survey.py" "$@" ;;
    closed-loop)  build-venv/bin/python -B "$here/../e2e/closed_loop.py" "$@" ;;
    sync)         one_program test_killed_sync && one_program test_make_candidates && python3 -B "$here/sync.py" "$@" ;;
    contract)     one_program test_make_candidates && one_program nadir && python3 -B "$here/contract_client.py" "$@" ;;
    tiles)        one_program bench_tiles && build/bin/bench_tiles "$@" ;;
    ortho)        one_program bench_ortho_frame && with_bench_python "$here/ortho.py" "$@" ;;
    attacks)      one_program make_flights && build-venv/bin/python -B "$here/attacks.py" "$@" ;;
    rules)        build-venv/bin/python -B "$here/../e2e/rule_flights.py" "$@" ;;
    chaos)        build-venv/bin/python -B "$here/../e2e/chaos.py" "$@" ;;
    sitl | px4)   build-venv/bin/python -B "$here/../e2e/sitl.py" "$@" ;;
    mavproxy)     one_program nadir && one_program nadird && python3 -B "$here/mavproxy.py" "$@" ;;
    soak)         one_program bench_fast_nadird && build-venv/bin/python -B "$here/../e2e/soak.py" "$@" ;;
    looks)        one_program bench_looks && build/bin/bench_looks "$@" ;;
    retrieval)    one_program bench_retrieval && build/bin/bench_retrieval "$@" ;;
    integrity)    one_program bench_integrity && build/bin/bench_integrity "$@" ;;
    matchers)     one_program bench_looks && one_program bench_matchers && "$here/matchers.sh" "$@" ;;
    fit-likelihood) one_program bench_fit_likelihood && build/bin/bench_fit_likelihood "$@" ;;
    *) usage >&2; exit 2 ;;
  esac
}

case ${1:-all} in
  all)
    part package --size-km 1 --tries 2
    part validators
    part kill --times 5
    part localization
    echo "NOT RUN unless asked for: the other parts, and kill with 50 moments (./run bench --help)" ;;
  -h | --help) usage ;;
  *) part "$@" ;;
esac
