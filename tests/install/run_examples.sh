#!/usr/bin/env bash
# Runs each program of examples/ and checks what it says.
# Usage: run_examples.sh EXAMPLES CELLMAP CELLMAPD FOLDER
set -euo pipefail
examples=$1 cellmap=$2 cellmapd=$3 folder=$4
rm -rf "$folder" && mkdir -p "$folder"

# says PATTERN COMMAND... : it succeeds, and its output has the pattern
says() {
  local pattern=$1; shift
  local out
  out=$("$@" 2>&1) || { echo "$1 failed: $out" >&2; exit 1; }
  grep -qE -e "$pattern" <<<"$out" || { echo "$1 said, without '$pattern': $out" >&2; exit 1; }
}

for source in "$(dirname "$0")"/../../examples/0*.cpp; do
  [[ $(wc -l <"$source") -lt 60 ]] || { echo "$source has 60 lines or more" >&2; exit 1; }
done
says 'became [0-9]{4,} planes' "$examples/01_build_a_cell"
says '^converged' "$examples/02_register_a_scan"
says '[0-9]+ constraints' "$examples/03_map_a_drive"

"$cellmap" simulate --route town --scans 50 --columns 600 --out "$folder/drive" --json >/dev/null
"$cellmap" build "$folder/drive" --store "$folder/map.db" --map town --session monday --lattice-size 20000 --json >/dev/null
"$cellmap" archive town --store "$folder/map.db" --out "$folder/town.cellmap" >/dev/null
says '^town at revision' "$examples/04_read_an_archive" "$folder/town.cellmap"

"$cellmapd" --store "$folder/map.db" --listen 127.0.0.1:0 --threads 1 --log-level error >"$folder/server.log" & server=$!
trap 'kill $server 2>/dev/null; wait $server 2>/dev/null || true' EXIT
for _ in $(seq 100); do
  url=$(grep -o 'http://[^ ]*' "$folder/server.log" || true)
  [[ -n $url ]] && break
  sleep 0.2
done
says 'confidence' "$examples/05_ask_a_server" "$url" town "$folder/drive/velodyne/000025.bin"
says 'CELLs are new' "$examples/06_follow_a_map" "$url" town 1
