#!/usr/bin/env bash
# The method with steps left out and with other backends: over the simulated flight, and over a recorded one.
#
# usage: ./run bench ablations [--data DIR]
#   DIR has frames/, telemetry.csv, camera.yaml, truth.csv, and for matching map.tif and mission.yaml
set -euo pipefail
data=
while [[ $# -gt 0 ]]; do
  case $1 in
    --data) data=${2:?--data DIR}; shift 2 ;;
    *) sed -n 's/^# \{0,1\}//p' "$0" | sed 1d; [[ $1 == --help || $1 == -h ]] && exit 0 || exit 2 ;;
  esac
done
ablations() { # FOLDER CAMERA [PACKAGE MISSION]
  build/bin/bench_ablations "$1/frames" "$1/telemetry.csv" "$2" "$1/truth.csv" \
    ${3:+"$3" "$work/root.json" "$(sed -n 's/^created: *//p' "$4")"}
}
if [[ -z $data ]]; then
  . tests/bench/flight.sh
  ablations "$work/flight" "$work/world/camera.yaml" "$work/package" "$work/world/mission.yaml"
elif [[ -f $data/map.tif ]]; then
  . tests/bench/keys.sh
  "$nadir" cache build --mission "$data/mission.yaml" --imagery "$data/map.tif" --key "$work/signer.key.pem" \
    --out "$work/package" --quiet >/dev/null
  ablations "$data" "$data/camera.yaml" "$work/package" "$data/mission.yaml"
else
  ablations "$data" "$data/camera.yaml"
fi
