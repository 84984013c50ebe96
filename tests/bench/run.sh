#!/usr/bin/env bash
# Measures CELLmap against the paper's way and prints a Markdown table (what its rows mean: BENCHMARK.md).
# Builds the release preset first where it is not up to date.
#
# Usage: ./tests/bench/run.sh [--quick] [--json FILE] [--only GROUPS] [--kitti00]
#   --quick        fewer repeats and a short drive: under a minute on two free cores (else about ten minutes)
#   --json FILE    also write {"machine": ..., "rows": [...]} to FILE
#   --only GROUPS  only these rows, separated by commas: nearest, cell, registration, loop, pose_graph, codec, store, ingest;
#                 and places, measured only where it is named: 10^5 and 10^6 synthetic places (minutes, 7 GB; a tenth with --quick)
#   --kitti00      also map a simulated drive of 4,541 scans along KITTI 00's route
#   --help         this text
# Real data is used where CELLMAP_DATA (default ../shared/data) has it. Exit code: 0, or 2 for a wrong flag or a file
# that cannot be written, or 1 where anything else failed.
set -euo pipefail

usage() { sed -n '2,/^set /p' "$0" | sed '$d; s/^# \{0,1\}//'; }
wrong() {
  echo "run.sh: $1; see ./tests/bench/run.sh --help" >&2
  exit 2
}

caller=$PWD
arguments=()
while [[ $# -gt 0 ]]; do
  case $1 in
    --help | -h) usage; exit 0 ;;
    --quick | --kitti00) arguments+=("$1") ;;
    --json | --only)
      [[ $# -ge 2 && $2 != --* ]] || wrong "$1 needs a value"
      value=$2
      [[ $1 == --only || $value == /* ]] || value=$caller/$value
      arguments+=("$1" "$value")
      shift ;;
    *) wrong "unknown argument '$1'" ;;
  esac
  shift
done

cd "$(dirname "$0")/../.."
export CELLMAP_DATA=${CELLMAP_DATA:-$PWD/../shared/data}
log=build/release/bench-build.log
bench=build/release/tests/bench/cellmap_bench
sources=(CMakeLists.txt CMakePresets.json lib schema tests/CMakeLists.txt tests/bench tests/support)
[[ -x $bench && -z $(find "${sources[@]}" -newer "$bench" -print -quit) ]] || {
  ./install-dependencies.sh >&2
  mkdir -p build/release
  echo "Building the benchmark with the release preset (log: $log) ..." >&2
  if ! { cmake --preset release && cmake --build --preset release --target cellmap_bench; } >"$log" 2>&1; then
    tail -n 30 "$log" >&2
    echo "run.sh: the build failed" >&2
    exit 1
  fi
  touch "$bench"  # it may have been up to date though a source is newer
}
exec "$bench" ${arguments[@]+"${arguments[@]}"}
