#!/usr/bin/env bash
# The whole way from imagery to a position, on a made-up landscape, with the programs as a user calls them.
set -euo pipefail
out=demo
nadir=build/bin/nadir
started=$SECONDS

say()  { printf '\n\033[1m%s\033[0m\n' "$*"; }
echo_and_run() { printf '  $ %s\n' "$*"; "$@"; }

rm -rf "$out"
mkdir -p "$out"

say "1  A landscape: as a satellite saw it (map.tif), and as it looks on the day of the flight (ground.tif)"
echo_and_run $nadir simulate world --seed 7 --size-km 2 --gsd-m 0.4 --out $out/world

say "2  Keys, and the root of trust that the aircraft knows"
echo_and_run $nadir keys create --out $out/root
echo_and_run $nadir keys create --out $out/signer
echo_and_run $nadir keys root --root-key $out/root.key.pem --package-signer $out/signer.pub.pem --expires 2035-01-01 --out $out/root.json

say "3  The mission's map package: cut, checked, hashed, signed"
created=$(sed -n 's/^created: *//p' $out/world/mission.yaml)
echo_and_run $nadir cache build --mission $out/world/mission.yaml --imagery $out/world/map.tif --dem $out/world/dem.tif --key $out/signer.key.pem --out $out/package

say "4  Verified as the aircraft does before take-off"
echo_and_run $nadir cache verify $out/package --trust $out/root.json --depth full --at "$created"

say "5  A flight over the landscape of the day, with sensors as bad as real ones"
echo_and_run $nadir simulate flight --world $out/world/ground.tif --dem $out/world/dem.tif --mission $out/world/mission.yaml \
  --camera $out/world/camera.yaml --seed 11 --noise real --out $out/flight

say "6  Localized without GPS: frames and telemetry against the package"
start=$(awk -F, 'NR == 1 { for (i = 1; i <= NF; ++i) column[$i] = i } NR == 2 { printf "%s,%s", $column["lon_deg"], $column["lat_deg"]; exit }' $out/flight/truth.csv)
echo_and_run $nadir replay --package $out/package --trust $out/root.json --at "$created" --frames $out/flight/frames \
  --telemetry $out/flight/telemetry.csv --camera $out/world/camera.yaml --start="$start" --truth $out/flight/truth.csv --out $out/report

say "Done in $((SECONDS - started)) s. Open $out/report/report.html"
