#!/usr/bin/env bash
# Map matchers side by side at the same looks: oriented channels, a descriptor network, its keypoints (XFeat), SIFT. Real sets where the
# data folder is.
#
# usage: ./run bench matchers MODEL.onnx [--looks N] [--results DIR] [--write]
#   --looks N      looks of each matcher (1000); results that are there are kept and continued
#   --results DIR  where they are kept (a temporary folder)
#   --write        looks of training seeds instead, and the table of a second matcher counted from them
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
cd "$here/../.."
model='' looks=1000 results='' write=''
while [[ $# -gt 0 ]]; do
  case $1 in
    --looks) looks=$2; shift 2 ;;
    --results) results=$2; shift 2 ;;
    --write) write=1; shift ;;
    -h | --help) sed -n '2,9s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;;
    *) model=$1; shift ;;
  esac
done
[[ -f $model ]] || { echo "matchers: NOT RUN: no model; docs/second-matcher.md names one" >&2; exit 2; }
if [[ -z $results ]]; then
  results=$(mktemp -d)
  trap 'rm -rf -- "$results"' EXIT
fi
mkdir -p "$results"
draw=(--seed 1000043 --worlds 8 --real 0.7 --right 0.3)
[[ -z $write ]] || draw=(--seed 41 --worlds 8)
kind=judge
[[ -z $write ]] || kind=train
take() { # NAME MATCHER
  build/bin/bench_looks --looks "$looks" "${draw[@]}" --matcher "$2" --resume "$results/$kind-$1.csv" >/dev/null
}
take channels channels
take network "$model"
files=("$results/$kind-channels.csv" "$results/$kind-network.csv")
if [[ -n $write ]]; then
  # The rare chance peaks of the 38 000 looks that the channels' own table was fitted to: at those alone.
  rare=()
  for stored in "1 0.35 4" "21 0.2 8"; do
    read -r seed right worlds <<<"$stored"
    for matcher in channels "$model"; do
      result=$results/rare-$seed-$(basename "$matcher").csv
      build/bin/bench_looks --seed "$seed" --right "$right" --worlds "$worlds" --chance-peaks-of tests/estimation/data/looks.bin \
        --matcher "$matcher" --resume "$result" >/dev/null
      rare+=("$result")
    done
  done
  build/bin/bench_matchers "${files[@]}" --chance-peaks "${rare[@]}" --model "$model" --write libgeo/estimation/second_likelihood_table.hpp
  exit
fi
take keypoints "keypoints:$model"
take sift sift
build/bin/bench_matchers "${files[@]}" "$results/$kind-keypoints.csv" "$results/$kind-sift.csv"
build/bin/bench_matchers "$results/$kind-channels.csv" "$results/$kind-keypoints.csv"    # how far these two err together
