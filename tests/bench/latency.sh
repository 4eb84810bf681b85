#!/usr/bin/env bash
# Where the CPU time of a frame goes, stage by stage, over flights above the day's landscape with three cameras; then
# what it costs to find a frame in 20 km². --far-world DIR: an existing world of 5.5 km; else one is generated, which
# takes some minutes.
set -euo pipefail
far_world=
if [[ ${1:-} == --far-world ]]; then far_world=$2; fi
. tests/bench/flight.sh
bin=build/bin
camera() { # WIDTH HEIGHT: the world's camera with more pixels
  awk -v w="$1" -v h="$2" '{ f = w / 1280 }
    $1 == "width:" { $2 = w } $1 == "height:" { $2 = h }
    $1 == "fx:" || $1 == "fy:" || $1 == "cx:" { $2 = $2 * f } $1 == "cy:" { $2 = $2 * h / 720 }
    { print }' "$work/world/camera.yaml"
}
stages() { # FOLDER: of a flight
  "$bin/bench_stages" "$work/package" "$work/root.json" "$(sed -n 's/^created: *//p' "$work/world/mission.yaml")" \
    "$1/frames" "$1/telemetry.csv" "$1/camera.yaml" "$1/truth.csv"
}
fly() { # WIDTH HEIGHT FRAMES NAME
  camera "$1" "$2" >"$work/$4.yaml"
  "$nadir" simulate flight --world "$work/world/ground.tif" --dem "$work/world/dem.tif" --frames "$3" --noise real \
    --mission "$work/world/mission.yaml" --camera "$work/$4.yaml" --seed 2 --out "$work/$4" --quiet >/dev/null
}
stages "$work/flight"
fly 1920 1080 40 fullhd && stages "$work/fullhd"
fly 6252 4168 8 large && stages "$work/large" # finer than the world: enlarged from it by the camera, not by a tool

if [[ -z $far_world ]]; then
  far_world=$work/far
  "$nadir" simulate world --seed 5 --size-km 5.5 --gsd-m 0.5 --out "$far_world" --quiet >/dev/null
fi
"$nadir" cache build --mission "$far_world/mission.yaml" --imagery "$far_world/map.tif" --dem "$far_world/dem.tif" \
  --key "$work/signer.key.pem" --out "$work/far-package" --quiet >/dev/null
"$nadir" cache index "$work/far-package" --key "$work/signer.key.pem" --camera "$far_world/camera.yaml" --quiet >/dev/null
"$nadir" simulate flight --world "$far_world/ground.tif" --dem "$far_world/dem.tif" --mission "$far_world/mission.yaml" \
  --camera "$far_world/camera.yaml" --seed 2 --noise real --frames 24 --interval-s 12 --out "$work/far-flight" --quiet >/dev/null
"$bin/bench_cold_start" "$work/far-package" "$work/root.json" "$(sed -n 's/^created: *//p' "$far_world/mission.yaml")" \
  "$work/far-flight/frames" "$work/far-flight/telemetry.csv" "$work/far-flight/camera.yaml" "$work/far-flight/truth.csv" \
  all index index-any hint far-hint
