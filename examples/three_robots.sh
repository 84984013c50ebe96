#!/usr/bin/env bash
# Three robots map one simulated town at the same time, each starting somewhere else on its route and knowing nothing of
# the others; one server makes one map of it. Prints what went over the wire, beside what the raw scans would have been.
# Usage: ./examples/three_robots.sh [FOLDER]     FOLDER: where drives and store go (default: a temporary one)
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-$(mktemp -d)}
mkdir -p "$folder"
cellmap=build/release/client/cellmap
[[ -x $cellmap && -x build/release/server/cellmapd ]] || {
  ./install-dependencies.sh
  cmake --preset release >"$folder/build.log"
  cmake --build --preset release --target cellmap_cli cellmapd >>"$folder/build.log"
}

# One town, three days: each robot sees other cars and has noise and odometry of its own.
for robot in 1 2 3; do
  [[ -d $folder/day$robot ]] || "$cellmap" simulate --scans 560 --traffic-seed "$robot" --out "$folder/day$robot"
done

build/release/server/cellmapd --store "$folder/store.db" --listen 127.0.0.1:0 >"$folder/server.out" 2>"$folder/server.log" &
server=$!
trap 'kill $server 2>/dev/null || true; wait $server 2>/dev/null || true' EXIT
until url=$(grep -o 'http://[^ ]*' "$folder/server.out"); do
  kill -0 $server 2>/dev/null || { cat "$folder/server.log" >&2; exit 1; }
  sleep 0.1
done

drive() {  # robot, first scan, scans
  "$cellmap" ingest "$folder/day$1" --cells --robot "cart-$1" --session "robot$1" --first-scan "$2" --scans "$3" \
    --server "$url" --map town
}
drive 1 0 260 &
first=$!
sleep 2
drive 2 180 260 &
second=$!
sleep 2
drive 3 360 200
wait $first
wait $second

"$cellmap" sessions town --server "$url"
"$cellmap" info town --server "$url"
