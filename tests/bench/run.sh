#!/usr/bin/env bash
# Figures against the tools that a user would pick instead, run side by side on a landscape that the bench makes itself.
# Ratios count, not seconds: machines differ.   usage: ./run bench
set -euo pipefail
nadir=$PWD/build/bin/nadir
work=$(mktemp -d "${TMPDIR:-/tmp}/nadir-bench.XXXXXX")
trap 'rm -rf "$work"' EXIT

cpu_seconds() { # user + system seconds of a command and its children
  local TIMEFORMAT='%U %S'
  { time "$@" >"$work/out" 2>"$work/err"; } 2>&1 | tail -n 1 | awk '{ print $1 + $2 }'
}
tiles_in() { sqlite3 "$1" 'select count(*), sum(length(tile_data)) from tiles' | tr '|' ' '; }

echo "== package: JPEG tiles and overviews, against gdal_translate -of MBTILES + gdaladdo"
"$nadir" simulate world --seed 1 --size-km 2 --gsd-m 0.4 --out "$work/world" --quiet >/dev/null
"$nadir" keys create --out "$work/signer" >/dev/null
ours=$(cpu_seconds "$nadir" cache build --mission "$work/world/mission.yaml" --imagery "$work/world/map.tif" \
  --dem "$work/world/dem.tif" --quality 75 --key "$work/signer.key.pem" --out "$work/package")
theirs=$(cpu_seconds bash -c "gdal_translate -q -of MBTILES -co TILE_FORMAT=JPEG -co QUALITY=75 '$work/world/map.tif' '$work/gdal.mbtiles' &&
  gdaladdo -q -r average '$work/gdal.mbtiles' 2 4 8 16")
read -r our_tiles our_bytes < <(tiles_in "file:$work/package/imagery/base.mbtiles?immutable=1")
read -r their_tiles their_bytes < <(tiles_in "$work/gdal.mbtiles")
awk -v a="$ours" -v n="$our_tiles" -v s="$our_bytes" -v b="$theirs" -v m="$their_tiles" -v t="$their_bytes" 'BEGIN {
  printf "nadir (checks, hashes and signs too)  %5d tiles  %6.1f CPU s  %6.0f bytes a tile\n", n, a, s / n
  printf "gdal_translate + gdaladdo             %5d tiles  %6.1f CPU s  %6.0f bytes a tile\n", m, b, t / m
  printf "tiles per CPU second, ratio %.2f; bytes a tile, ratio %.2f\n", n / a / (m / b), s / n / (t / m) }'

echo "== localization: a flight of sixty frames over the day's landscape, against the satellite's"
"$nadir" keys create --out "$work/root" >/dev/null
"$nadir" keys root --root-key "$work/root.key.pem" --package-signer "$work/signer.pub.pem" --expires 2035-01-01 \
  --out "$work/root.json" >/dev/null
"$nadir" simulate flight --world "$work/world/ground.tif" --dem "$work/world/dem.tif" --mission "$work/world/mission.yaml" \
  --camera "$work/world/camera.yaml" --seed 2 --noise real --out "$work/flight" --quiet >/dev/null
start=$(awk -F, 'NR == 1 { for (i = 1; i <= NF; ++i) column[$i] = i }
  NR == 2 { print $column["lon_deg"] "," $column["lat_deg"]; exit }' "$work/flight/truth.csv")
"$nadir" replay --package "$work/package" --trust "$work/root.json" --at "$(sed -n 's/^created: *//p' "$work/world/mission.yaml")" \
  --frames "$work/flight/frames" --telemetry "$work/flight/telemetry.csv" --camera "$work/world/camera.yaml" \
  --truth "$work/flight/truth.csv" --start="$start" --out "$work/report" --quiet
