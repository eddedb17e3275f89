#!/usr/bin/env bash
# The whole story on a machine with nothing installed: builds the release programs, starts the daemon on the simulated
# station, teaches it good parts, lets a PLC stand-in trigger good and bad parts over Modbus, and draws the last one.
#   app/demo.sh [--out DIR]     (default: build/demo)
set -euo pipefail
cd "$(dirname "$0")/.."

out=build/demo
if [ "${1:-}" = --out ]; then
  out=${2:?--out needs a folder}
elif [ $# -gt 0 ]; then
  echo "error: unknown option $1 (known: --out DIR)" >&2
  exit 2
fi

# shellcheck source=app/packages.sh
. app/packages.sh
app/install_packages.sh "${BUILD_PACKAGES[@]}"

echo "== building the release programs (first time: a few minutes)"
cmake --preset release -DBUILD_TESTING=OFF >/dev/null
cmake --build --preset release

tool=build/release/app/brdfgate
rm -rf "$out"
mkdir -p "$out"

echo "== teaching the reference material from ten good parts (scene config/scenes/good.yaml)"
$tool teach --live --parts 10 --name "red part with white print" --out "$out/good.recipe.yaml"

echo "== starting brdfgated on the simulated station"
build/release/app/brdfgated --config config/station.yaml --recipe "$out/good.recipe.yaml" --port 0 \
  --port-file "$out/port" --state-dir "$out/state" --evidence "$out/last_part" 2>"$out/brdfgated.log" &
daemon=$!
trap 'kill "$daemon" 2>/dev/null || true; wait "$daemon" 2>/dev/null || true' EXIT
for _ in $(seq 100); do
  [ -s "$out/port" ] && break
  kill -0 "$daemon" 2>/dev/null || { cat "$out/brdfgated.log" >&2; exit 2; }
  sleep 0.1
done
port=$(cat "$out/port")

echo "== a PLC triggers seven parts on 127.0.0.1:$port: two good ones, wrong gloss, wrong colour, a stain, upside down, a good one"
$tool plc watch 127.0.0.1 --port "$port" --trigger 1 1 2 3 4 5 1 || verdict=$?
# 1: a part was rejected, which is what this story is about.
[ "${verdict:-0}" -eq 1 ] || { echo "error: expected rejects among the verdicts" >&2; exit 2; }

kill "$daemon" && wait "$daemon" 2>/dev/null || true
trap - EXIT
echo "== pictures of the last part"
ls "$PWD/$out/last_part"/*.png
echo "recipe: $PWD/$out/good.recipe.yaml, the daemon's log: $PWD/$out/brdfgated.log"
