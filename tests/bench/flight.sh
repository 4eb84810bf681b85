# Sourced: $nadir, and in $work a world, its signed package, and a flight of sixty frames over it on another day.
. tests/bench/keys.sh

"$nadir" simulate world --seed 1 --size-km 2 --gsd-m 0.4 --out "$work/world" --quiet >/dev/null
"$nadir" cache build --mission "$work/world/mission.yaml" --imagery "$work/world/map.tif" --dem "$work/world/dem.tif" \
  --key "$work/signer.key.pem" --out "$work/package" --quiet >/dev/null
"$nadir" simulate flight --world "$work/world/ground.tif" --dem "$work/world/dem.tif" --mission "$work/world/mission.yaml" \
  --camera "$work/world/camera.yaml" --seed 2 --noise real --out "$work/flight" --quiet >/dev/null
