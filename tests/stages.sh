#!/usr/bin/env bash
# What continuous integration runs: every stage, even after one that failed, each with a line of summary, and all of
# these lines at the end. Exit code 1 if a stage failed.
# Usage: ./tests/stages.sh [STAGE...]     STAGE: format includes release tidy asan tsan
set -uo pipefail
cd "$(dirname "$0")/.."
export CELLMAP_DATA=${CELLMAP_DATA:-$PWD/../shared/data}
logs=build/stages
mkdir -p "$logs"

# Of the rooms that read what comes from outside, and of those that share data between threads: all stages together may take
# 25 minutes on two processors. `./tests/run.sh asan` and `tsan` run every room.
asan_rooms=(core scan codec archive rosbag store auth server fuzz)
tsan_rooms=(store auth)

# rooms_of PRESET ROOM...: builds and runs the tests of these rooms.
rooms_of() {
  local preset=$1 room targets=()
  shift
  cmake --preset "$preset" || return 1
  for room in "$@"; do
    if [[ $room == fuzz ]]; then targets+=(fuzz_replay); else targets+=("${room}_test"); fi
  done
  cmake --build --preset "$preset" --target "${targets[@]}" || return 1
  ctest --preset "$preset" -L "^($(IFS='|'; echo "$*"))\$" --no-tests=error
}

format() { tests/style/check_format.sh; }
includes() { python3 tests/includes/check_includes.py --self-test && python3 tests/includes/check_includes.py .; }
release() { cmake --preset release && cmake --build --preset release && ctest --preset release; }
tidy() { cmake --preset release >/dev/null && cmake --build --preset release --target cellmap_schema && tests/style/check_tidy.sh build/release; }
asan() { rooms_of asan "${asan_rooms[@]}"; }
tsan() { rooms_of tsan "${tsan_rooms[@]}"; }

# failures LOG: the tests that failed and what they printed; of other stages the last lines.
failures() {
  awk '/\*\*\*(Failed|Timeout|Exception|Not Run)/ {printing = 1; print; next}
       /^ *(Start +[0-9]+:|[0-9]+\/[0-9]+ Test )/ {printing = 0}
       printing || /^(FAILED: |.*error: )/ {print}' "$1" | grep . || tail -20 "$1"
}

stages=("$@")
[[ $# -gt 0 ]] || stages=(format includes release tidy asan tsan)
lines=()
failed_logs=()
failed=0
for stage in "${stages[@]}"; do
  [[ " format includes release tidy asan tsan " == *" $stage "* ]] || { echo "No stage is called '$stage'." >&2; exit 2; }
  echo "=== $stage"
  begin=$SECONDS
  "$stage" 2>&1 | tee "$logs/$stage.log"
  case ${PIPESTATUS[0]} in
    0) result=passed ;;
    77) result=SKIPPED ;;
    *) result=FAILED failed=1 ;;
  esac
  # How much the stage looked at, by its own last word: "... tests failed out of 1489", "908 files are formatted".
  count=$(grep -oE 'out of [0-9]+|^[0-9]+ (files|groups)' "$logs/$stage.log" | tail -1 | sed -E 's/out of ([0-9]+)/\1 tests/')
  lines+=("$stage: $result, ${count:-0 tests}, $((SECONDS - begin)) s")
  echo "${lines[-1]}"
  [[ $result != FAILED ]] || failed_logs+=("$logs/$stage.log")
done
# Once more at the end, which is what is seen first of a long log.
for log in "${failed_logs[@]}"; do
  echo "=== failed, of $log"
  failures "$log" | cut -c1-300 | tail -100
done
printf '%s\n' "=== all stages, $SECONDS s" "${lines[@]}"
exit "$failed"
