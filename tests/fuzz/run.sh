#!/usr/bin/env bash
# Builds the fuzz targets with clang (preset fuzz) and runs each for a while from the seeds of make_seeds.py. What they find
# is in build/fuzz/findings/; the corpus grows in build/fuzz/corpus/.
#
# Usage: ./tests/fuzz/run.sh [--seconds N] [TARGET...]
#   --seconds N   of each target: 60
#   TARGET        a name of tests/fuzz/CMakeLists.txt, such as request_head; default: all
# Exit code: 0, or 1 where a target crashed, leaked or hung, or 2 for a wrong argument.
set -euo pipefail
seconds=60
targets=()
while [[ $# -gt 0 ]]; do
  case $1 in
    --help | -h) sed -n '2,/^set /p' "$0" | sed '$d; s/^# \{0,1\}//'; exit 0 ;;
    --seconds)
      [[ ${2-} =~ ^[0-9]+$ ]] || { echo "run.sh: --seconds needs a number" >&2; exit 2; }
      seconds=$2
      shift ;;
    -*) echo "run.sh: unknown argument '$1'; see ./tests/fuzz/run.sh --help" >&2; exit 2 ;;
    *) targets+=("$1") ;;
  esac
  shift
done
cd "$(dirname "$0")/../.."
./install-dependencies.sh --without-pcl --with-fuzzers
cmake --preset fuzz >/dev/null
IFS=';' read -ra all <<<"$(cat build/fuzz/tests/fuzz/targets.txt)"
[[ ${#targets[@]} -gt 0 ]] || targets=("${all[@]}")
for target in "${targets[@]}"; do
  [[ " ${all[*]} " == *" $target "* ]] || { echo "run.sh: no target '$target'; there are ${all[*]}" >&2; exit 2; }
done
cmake --build --preset fuzz --target "${targets[@]/#/fuzz_}"
python3 tests/fuzz/make_seeds.py build/fuzz/seeds
failed=0
for target in "${targets[@]}"; do
  mkdir -p "build/fuzz/corpus/$target" "build/fuzz/findings" "build/fuzz/seeds/$target"
  log=build/fuzz/$target.log
  if "build/fuzz/tests/fuzz/$target" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -print_final_stats=1 \
    -artifact_prefix="build/fuzz/findings/$target-" "build/fuzz/corpus/$target" "build/fuzz/seeds/$target" >"$log" 2>&1; then
    echo "$target: nothing found, $(sed -n 's/^stat::number_of_executed_units: *//p' "$log") runs"
  else
    failed=1
    echo "$target: FOUND $(ls build/fuzz/findings/"$target"-* 2>/dev/null | tail -n 1 || true); $log says what" >&2
    tail -n 15 "$log" >&2
  fi
done
exit $failed
