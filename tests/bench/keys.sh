# Sourced: $nadir, and in $work, which goes with the shell, a signer's keys and a root that trusts them.
nadir=$PWD/build/bin/nadir
work=$(mktemp -d "${TMPDIR:-/tmp}/nadir-bench.XXXXXX")
trap 'rm -rf "$work"' EXIT

for name in signer root; do "$nadir" keys create --out "$work/$name" >/dev/null; done
"$nadir" keys root --root-key "$work/root.key.pem" --package-signer "$work/signer.pub.pem" --expires 2035-01-01 \
  --out "$work/root.json" >/dev/null
