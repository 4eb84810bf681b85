#!/usr/bin/env bash
# A flight of sixty frames over the day's landscape, against the satellite's: errors and stated accuracy.
set -euo pipefail
. tests/bench/flight.sh
start=$(awk -F, 'NR == 1 { for (i = 1; i <= NF; ++i) column[$i] = i }
  NR == 2 { print $column["lon_deg"] "," $column["lat_deg"]; exit }' "$work/flight/truth.csv")
"$nadir" replay --package "$work/package" --trust "$work/root.json" --at "$(sed -n 's/^created: *//p' "$work/world/mission.yaml")" \
  --frames "$work/flight/frames" --telemetry "$work/flight/telemetry.csv" --camera "$work/world/camera.yaml" \
  --truth "$work/flight/truth.csv" --start="$start" --out "$work/report" --quiet
