#!/usr/bin/env bash
# From a fresh clone to a CELLmap behind a running server, and what it can do.
# Usage: ./examples/quickstart.sh [--dataset DIR [--poses FILE]] [--scans N] [--keep]
#   --dataset DIR   a LiDAR drive (KITTI odometry folder, or .bin/.pcd/.ply scans with a trajectory) instead of
#                   the simulator's sample drive
#   --poses FILE    its odometry (default: DIR/poses.txt)
#   --scans N       length of the simulated drive (default 700)
#   --keep          leave the server running at the end and print its address
set -euo pipefail
cd "$(dirname "$0")/.."

dataset="" poses="" scans=700 keep=false
while [[ $# -gt 0 ]]; do
  case $1 in
    --dataset) dataset=${2:?--dataset needs a folder}; shift 2 ;;
    --poses) poses=${2:?--poses needs a file}; shift 2 ;;
    --scans) scans=${2:?--scans needs a number}; shift 2 ;;
    --keep) keep=true; shift ;;
    -h|--help) sed -n '2,8s/^# \{0,1\}//p' "$0"; exit 0 ;;
    *) echo "quickstart.sh: unknown argument '$1'; see --help" >&2; exit 2 ;;
  esac
done
say() { printf '\n\033[1m== %s\033[0m\n' "$*"; }

say "Build"
./install-dependencies.sh
log=build/quickstart-build.log
mkdir -p build
if ! { cmake --preset release && cmake --build --preset release --target cellmap_cli cellmapd; } >"$log" 2>&1; then
  tail -n 40 "$log" >&2
  echo "The build failed; the whole log is in $log" >&2
  exit 1
fi
cellmap=build/release/client/cellmap
echo "Built $($cellmap --version)"
if command -v npm >/dev/null; then
  web/run.sh build --out build/release/web >>"$log" 2>&1 || echo "The viewer could not be built (the server works without it): see $log"
fi

work=build/quickstart
mkdir -p "$work"
if [[ -z $dataset ]]; then
  dataset=$work/town-$scans
  if [[ ! -f $dataset/done ]]; then
    say "A simulated drive with loops ($scans scans), and another car's scans on another day, one lane over"
    rm -rf "$dataset" "$dataset-query"
    $cellmap simulate --route town --scans "$scans" --odometry drift --out "$dataset" --progress
    $cellmap simulate --route town --scans 60 --lateral-offset 1.5 --traffic-seed 7 --odometry truth --out "$dataset-query"
    touch "$dataset/done"
  fi
  query=$dataset-query/velodyne/000050.bin
  query_truth=$(sed -n 51p "$dataset-query/poses_gt.txt")
fi

say "Server"
rm -f "$work"/map.db*
build/release/server/cellmapd --store "$work/map.db" --listen 127.0.0.1:0 --threads "$(nproc)" \
  >"$work/cellmapd.out" 2>"$work/cellmapd.log" &
server_pid=$!
stop_server() { kill "$server_pid" 2>/dev/null && wait "$server_pid" 2>/dev/null || true; }
trap stop_server EXIT
for _ in $(seq 100); do
  url=$(grep -o 'http://[^ ]*' "$work/cellmapd.out" || true)
  [[ -n $url ]] && break
  kill -0 "$server_pid" 2>/dev/null || { cat "$work/cellmapd.log" >&2; exit 1; }
  sleep 0.1
done
echo "cellmapd listens on $url"

say "Ingest: scans with odometry become CELLs with poses"
$cellmap ingest "$dataset" ${poses:+--poses "$poses"} --server "$url" --map quickstart --progress >/dev/null

say "The map"
$cellmap info quickstart --server "$url"

say "Fetch a CELL; ask again with its ETag"
cell=$url/v1/maps/quickstart/cells/$($cellmap cells quickstart --server "$url" --limit 1 --json |
  python3 -c 'import json, sys; print(json.load(sys.stdin)["cells"][0]["id"])')
etag=$(curl -sS -D - -o "$work/cell.bin" "$cell" | tr -d '\r' | awk 'tolower($1) == "etag:" {print $2}')
echo "GET $cell"
echo "  $(stat -c %s "$work/cell.bin") bytes, ETag $etag"
echo "  with If-None-Match: HTTP $(curl -sS -o /dev/null -w '%{http_code}' -H "If-None-Match: $etag" "$cell")"

if [[ -n ${query:-} ]]; then
  say "Where am I? A scan that the map was not built from, no prior pose"
  $cellmap relocalise "$query" --server "$url" --map quickstart --truth-row "$query_truth"
fi

say "The trajectory, as the odometry gave it and after the back end"
$cellmap export trajectory --server "$url" --map quickstart --format kitti --stage odometry --out "$work/odometry.txt" >/dev/null
$cellmap export trajectory --server "$url" --map quickstart --format kitti --out "$work/optimised.txt" >/dev/null
if [[ -f $dataset/poses_gt.txt ]]; then
  echo "odometry:"
  $cellmap evaluate trajectory --estimate "$work/odometry.txt" --truth "$dataset/poses_gt.txt"
  echo "after bidirectional registration and loop closures:"
  $cellmap evaluate trajectory --estimate "$work/optimised.txt" --truth "$dataset/poses_gt.txt"
else
  echo "No poses_gt.txt in $dataset to compare with; the trajectories are in $work."
fi

if $keep; then
  trap - EXIT
  disown "$server_pid"
  say "The server stays at $url: open it in a browser (stop it with: kill $server_pid)"
else
  say "Done; the server stops (--keep leaves it running)"
fi
