#!/usr/bin/env bash
# From imagery to a position, from flown frames to the next map, and a live flight, over a simulated landscape, with the
# programs as a user calls them. At the end the flight is at the desk, which stays open where somebody sits at a terminal.
# Exit code 1: the live flight violated a rule of docs/onboard.md.
#
# usage: ./run demo [--no-desk]
set -euo pipefail
desk=yes
for option in "$@"; do
  [[ $option == --no-desk ]] || { echo "usage: ./run demo [--no-desk]" >&2; exit 2; }
  desk=no
done
out=demo
nadir=build/bin/nadir
service=build/bin/nadir-candidates
started=$SECONDS

say()  { printf '\n\033[1m%s\033[0m\n' "$*"; }
start_of() { # where a simulated flight begins: LON,LAT
  awk -F, 'NR == 1 { for (i = 1; i <= NF; ++i) column[$i] = i }
           NR == 2 { printf "%s,%s", $column["lon_deg"], $column["lat_deg"]; exit }' "$1/truth.csv"
}
echo_and_run() { printf '  $ %s\n' "$*"; "$@"; }

rm -rf "$out"
mkdir -p "$out"

say "1  A landscape: as a satellite image (map.tif), and on the day of the flight (ground.tif)"
echo_and_run $nadir simulate world --seed 7 --size-km 2 --gsd-m 0.4 --out $out/world

say "2  Keys, and the root of trust: who signs maps, who provisions aircraft, who signs each aircraft's tiles"
for key in root signer hangar mini-07 mini-08; do echo_and_run $nadir keys create --out $out/$key; done
echo_and_run $nadir keys root --root-key $out/root.key.pem --package-signer $out/signer.pub.pem --airframe-signer $out/hangar.pub.pem \
  --tile-signer mini-07=$out/mini-07.pub.pem --tile-signer mini-08=$out/mini-08.pub.pem --expires 2035-01-01 --out $out/root.json

say "3  The mission's map package: built, checked, hashed, signed"
created=$(sed -n 's/^created: *//p' $out/world/mission.yaml)
sed 's/^airframes: .*/airframes: [mini-07, mini-08]/' $out/world/mission.yaml > $out/mission.yaml
echo_and_run $nadir cache build --mission $out/mission.yaml --imagery $out/world/map.tif --dem $out/world/dem.tif --key $out/signer.key.pem \
  --trust $out/root.json --at "$created" --out $out/package

say "4  Verified as the aircraft does before take-off"
echo_and_run $nadir cache verify $out/package --trust $out/root.json --depth full --at "$created"

say "5  A flight over the landscape on that day, with realistic sensor errors"
echo_and_run $nadir simulate flight --world $out/world/ground.tif --dem $out/world/dem.tif --mission $out/mission.yaml \
  --camera $out/world/camera.yaml --seed 11 --noise real --out $out/flight

say "6  Localized without GPS: frames and telemetry against the package"
echo_and_run $nadir replay --package $out/package --trust $out/root.json --at "$created" --frames $out/flight/frames \
  --telemetry $out/flight/telemetry.csv --camera $out/world/camera.yaml --start="$(start_of $out/flight)" --truth $out/flight/truth.csv --out $out/report

say "7  A second aircraft flies the same route on another day; the frames of both become signed candidate tiles"
echo_and_run $nadir simulate flight --world $out/world/ground.tif --dem $out/world/dem.tif --mission $out/mission.yaml \
  --camera $out/world/camera.yaml --seed 12 --noise real --out $out/flight2
day=0
for airframe in mini-07 mini-08; do
  day=$((day + 1))
  flight=$out/flight; [[ $airframe == mini-08 ]] && flight=$out/flight2
  echo_and_run $nadir ortho --package $out/package --trust $out/root.json --at "$created" --frames $flight/frames \
    --telemetry $flight/telemetry.csv --camera $out/world/camera.yaml --start="$(start_of $flight)" \
    --key $out/$airframe.key.pem --airframe $airframe --captured "$(date -u -d "$created + $day day" +%FT%TZ)" \
    --out $out/candidates-$airframe
done

say "8  After landing: the candidate service checks the tiles, the two flights vote, and what they agree on is promoted"
echo_and_run $service token create --tokens $out/tokens.json --id ground-1 --out $out/ground-1.token
$service serve --data $out/service --trust $out/root.json --tokens $out/tokens.json \
  --package $out/package --listen 127.0.0.1:0 --port-file $out/port --max-age-days 3650 --quiet &
service_id=$!
trap 'kill $service_id 2>/dev/null || true' EXIT
while [[ ! -s $out/port ]]; do kill -0 $service_id; sleep 0.1; done
for airframe in mini-07 mini-08; do
  echo_and_run $nadir sync stage $out/candidates-$airframe --outbox $out/outbox --key $out/$airframe.key.pem --trust $out/root.json
done
# Exit code 1: some tile was rejected. One in hundreds correlates with the map at a wrong offset by chance.
echo_and_run $nadir sync push $out/outbox --to "http://localhost:$(< $out/port)" --token-file $out/ground-1.token || [[ $? == 1 ]]
while $service status --data $out/service | grep -qE '^waiting for a vote +[1-9]|^ +being judged +[1-9]'; do sleep 0.2; done
echo_and_run $service status --data $out/service
echo_and_run $service export --data $out/service --out $out/promoted
kill $service_id && wait $service_id

say "9  The next package: promoted tiles on top of the satellite image"
sed -e "s/^sequence: .*/sequence: 2/" -e "s/^created: .*/created: $(date -u -d "$created + 3 day" +%FT%TZ)/" $out/mission.yaml > $out/next.yaml
echo_and_run $nadir cache build --mission $out/next.yaml --imagery $out/promoted/*.tif --imagery $out/world/map.tif --dem $out/world/dem.tif \
  --key $out/signer.key.pem --trust $out/root.json --at "$(date -u -d "$created + 3 day" +%FT%TZ)" --out $out/next
echo_and_run $nadir cache verify $out/next --trust $out/root.json --depth full --at "$(date -u -d "$created + 3 day" +%FT%TZ)"
printf '  $ %s\n' "$nadir cache diff $out/package $out/next | head -n 1"
{ $nadir cache diff $out/package $out/next || [[ $? == 1 ]]; } | head -n 1

say "10  Live, in real time: an aircraft that navigates by nadird's positions. GPS is spoofed after a minute, then the camera goes dark"
judged=0
echo_and_run build-venv/bin/python -B tests/e2e/closed_loop.py --scenario demo --minutes 2.2 --signed --inputs $out --airframe mini-07 --width 1280 \
  --out $out/live --report $out/live.html --check rules || judged=$?

if [[ $desk == yes ]]; then
  say "11  The flight at the desk: its frames are sent in batches, localized as they arrive, and refined"
  stay=()
  [[ -t 1 ]] || stay=(--leave)
  say "Done in $((SECONDS - started)) s. Open $out/report/report.html and $out/live.html, and the desk:"
  python3 -B missions/demo_desk.py $out --nadir $nadir --at "$created" --start "$(start_of $out/flight)" "${stay[@]}"
else
  say "Done in $((SECONDS - started)) s. Open $out/report/report.html and $out/live.html"
fi
exit $judged
