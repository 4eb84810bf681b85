#!/usr/bin/env bash
# Where the CPU time of a frame goes, stage by stage, over a flight above the day's landscape.
set -euo pipefail
. tests/bench/flight.sh
build/bin/bench_stages "$work/package" "$work/root.json" "$(sed -n 's/^created: *//p' "$work/world/mission.yaml")" \
  "$work/flight/frames" "$work/flight/telemetry.csv" "$work/world/camera.yaml" "$work/flight/truth.csv"
